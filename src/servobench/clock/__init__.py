"""Clocks: who keeps the time of a run. A clock waits for each tick and latches its sample."""

from servobench.clock.base import Clock as Clock
from servobench.clock.base import Missed as Missed
from servobench.clock.base import Phase as Phase
from servobench.clock.base import Tick as Tick
from servobench.clock.choice import clock_for as clock_for
from servobench.clock.device import DeviceClock as DeviceClock
from servobench.clock.host import HostClock as HostClock
from servobench.clock.virtual import VirtualClock as VirtualClock
from servobench.clock.wake_up import WakeUps as WakeUps
from servobench.clock.wake_up import wake_ups as wake_ups
