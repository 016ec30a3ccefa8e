"""`make demo-rig`: the firmware in simavr at a pseudo-terminal, and `servobench run` on it, as on a board at a serial port."""

import subprocess
import sys

import pytest

from tests.rig.simavr.terminal import terminal


def main() -> int:
    """Run the command on a simulated rig; return its exit status."""
    try:
        with terminal() as rig:
            print(f"the rig's firmware runs in simavr at {rig.port}", flush=True)
            words = ["run", "--device", f"rig:{rig.port} watchdog=200ms", *sys.argv[1:]]
            return subprocess.run([sys.executable, "-m", "servobench", *words]).returncode
    except pytest.skip.Exception as missing:
        print(missing, file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
