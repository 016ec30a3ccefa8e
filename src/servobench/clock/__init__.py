"""Clocks: who keeps the time of a run. A clock waits for each tick and latches its sample."""

from servobench.clock.base import Clock as Clock
from servobench.clock.base import DeviceClock as DeviceClock
from servobench.clock.base import HostClock as HostClock
from servobench.clock.base import Tick as Tick
from servobench.clock.base import VirtualClock as VirtualClock
from servobench.clock.base import clock_for as clock_for
