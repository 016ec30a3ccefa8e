"""A second try for a test that failed on a busy computer, with all that it uses made anew; docs/decisions/0063 says why."""

from __future__ import annotations

import os
from typing import Any

import pytest
from _pytest.runner import runtestprotocol

FIRST = "failed at first, on a busy computer"


def is_busy() -> bool:
    """Whether the computer has had more work than processors in the last minute."""
    return hasattr(os, "getloadavg") and os.getloadavg()[0] > (os.cpu_count() or 1)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: Any, nextitem: pytest.Item | None) -> bool:
    """Run a test, and once more where it failed and the computer is busy; what it failed at is kept with the reports."""
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    reports = runtestprotocol(item, nextitem=nextitem, log=False)
    failed = [str(each.longrepr) for each in reports if each.failed]
    # The time that a test has is for both tries: where it is over nothing would end a second one.
    if failed and is_busy() and not any("Timeout (>" in each for each in failed):
        try:
            item.session._setupstate.teardown_exact(None)
        except Exception as error:  # what is broken may break on its way out, too
            failed.append(repr(error))
        item._initrequest()
        item.user_properties.append((FIRST, "\n".join(failed)))
        reports = runtestprotocol(item, nextitem=nextitem, log=False)
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Show what failed at first, whatever came of the second try."""
    found = {
        report.nodeid: text
        for reports in terminalreporter.stats.values()
        for report in reports
        for what, text in getattr(report, "user_properties", ())
        if what == FIRST
    }
    if not found:
        return
    terminalreporter.section(FIRST)
    for test, text in found.items():
        terminalreporter.line(f"{test}\n{text}\n")
