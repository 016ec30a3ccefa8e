"""Real-time scheduling, always in a process of its own: the tests themselves stay as they are."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from servobench.core.errors import UsageError
from servobench.rig.loop import schedule
from servobench.rig.loop.schedule import Scheduling, real_time

LINUX = sys.platform == "linux"

# What the system says of a process, after it asked for all that there is.
ASKED = """
import gc, json, os, subprocess, sys
{before}
from servobench.rig.loop.schedule import real_time
found = real_time({arguments})
told = {{"granted": found.granted, "denied": found.denied, "gc": gc.isenabled(), "frozen": gc.get_freeze_count(),
        "sentences": [finding.sentence for finding in found.findings()]}}
if sys.platform == "linux":
    status = dict(line.split(":", 1) for line in open("/proc/self/status") if ":" in line)
    told |= {{"policy": os.sched_getscheduler(0), "priority": os.sched_getparam(0).sched_priority,
             "cpus": sorted(os.sched_getaffinity(0)), "locked": int(status["VmLck"].split()[0]),
             "child": int(os.popen("awk '{{print $41}}' /proc/self/stat").read())}}
print(json.dumps(told))
"""
# Without privileges, whoever runs the tests: neither root nor a limit above nothing.
PLAIN = """
import resource
resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
resource.setrlimit(resource.RLIMIT_MEMLOCK, (65536, 65536))
if os.geteuid() == 0:
    import servobench.rig.loop.schedule
    os.setgroups([])
    os.setgid(65534)
    os.setuid(65534)
"""


def asked(before: str = "", arguments: str = "") -> dict[str, object]:
    done = subprocess.run(
        [sys.executable, "-c", ASKED.format(before=before, arguments=arguments)],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    told: dict[str, object] = json.loads(done.stdout)
    return told


def named(phrases: object, words: str) -> bool:
    assert isinstance(phrases, list)
    return any(words in phrase for phrase in phrases)


@pytest.mark.promise("S34")
def test_what_is_said_to_be_granted_is_what_the_system_says_of_the_process() -> None:
    told = asked()

    assert told["gc"] is False
    assert isinstance(told["frozen"], int)
    assert told["frozen"] > 0
    if LINUX:
        fifo = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
        assert (told["policy"], told["priority"]) == (
            (fifo, schedule.PRIORITY) if named(told["granted"], "SCHED_FIFO") else (os.SCHED_OTHER, 0)
        )
        assert (told["locked"] != 0) == named(told["granted"], "memory")
        assert named(told["granted"], "processor") == (told["cpus"] == [max(os.sched_getaffinity(0))])
        # 0 is SCHED_OTHER: what the process starts doesn't go before everybody else.
        assert told["child"] == 0


@pytest.mark.promise("S34")
@pytest.mark.skipif(not LINUX, reason="real-time scheduling is Linux's")
def test_without_privileges_it_runs_all_the_same_and_says_what_was_denied_and_how_to_permit_it() -> None:
    told = asked(PLAIN)

    assert (told["policy"], told["locked"]) == (os.SCHED_OTHER, 0)
    assert named(told["denied"], "real-time priority (operation not permitted)")
    assert named(told["denied"], "memory locked (no more than 64 KiB may be locked)")
    assert named(told["granted"], "nanosecond timers")
    assert isinstance(told["sentences"], list)
    (sentence,) = told["sentences"]
    for part in ("without memory locked", "rtprio 99", "memlock unlimited", "CAP_SYS_NICE"):
        assert part in sentence


@pytest.mark.skipif(not LINUX, reason="real-time scheduling is Linux's")
def test_the_process_stays_on_the_processor_that_was_named() -> None:
    first = min(os.sched_getaffinity(0))

    assert asked(arguments=f"cpu={first}")["cpus"] == [first]


@pytest.mark.skipif(not LINUX, reason="real-time scheduling is Linux's")
def test_a_processor_that_is_not_there_is_named_with_those_that_are() -> None:
    with pytest.raises(
        UsageError, match="processor 100000 isn't one that this process may use; expected one of"
    ):
        schedule._stay_on(100000)


@pytest.mark.parametrize("priority", [0, 100])
def test_a_priority_that_the_system_does_not_know_is_refused_before_anything_is_changed(
    priority: int,
) -> None:
    with pytest.raises(UsageError, match=f"priority of {priority} isn't possible; expected 1 to 99"):
        real_time(priority=priority)


@pytest.mark.promise("S34")
@pytest.mark.skipif(not LINUX, reason="real-time scheduling is Linux's")
def test_no_real_time_priority_where_the_kernel_would_stop_the_loop_in_each_second(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(schedule, "_real_time_share", lambda: 0.1)
    monkeypatch.setattr(schedule, "_set_fifo", lambda priority: pytest.fail("it asked all the same"))

    with pytest.raises(schedule._Denied, match="leaves only 10 % of a processor"):
        schedule._go_first(80)


def test_all_granted_is_one_sentence_and_no_advice() -> None:
    (finding,) = Scheduling(granted=("one thing", "another", "a third")).findings()

    assert (finding.code, finding.sentence) == (
        "real-time",
        "The loop ran with one thing, another and a third.",
    )
