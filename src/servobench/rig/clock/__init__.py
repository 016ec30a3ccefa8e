"""Clocks: who keeps the time of a run. A clock waits for each tick and latches its sample."""

from servobench.rig.clock.base import Clock as Clock
from servobench.rig.clock.base import Missed as Missed
from servobench.rig.clock.base import Phase as Phase
from servobench.rig.clock.base import Tick as Tick
from servobench.rig.clock.choice import clock_for as clock_for
from servobench.rig.clock.device import DeviceClock as DeviceClock
from servobench.rig.clock.host import HostClock as HostClock
from servobench.rig.clock.virtual import VirtualClock as VirtualClock
from servobench.rig.clock.wake_up import WakeUps as WakeUps
from servobench.rig.clock.wake_up import wake_ups as wake_ups
