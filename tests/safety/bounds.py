"""What answering anything a stranger hands over may cost, and how the cost is measured."""

import re
from pathlib import Path

MAX_CPU_S, MAX_BYTES = 5.0, 500 << 20


def peak(*, reset: bool = False) -> int:
    """Return the most memory that the process has held, in bytes, since it was last ``reset``."""
    if reset:
        Path("/proc/self/clear_refs").write_text("5")
    status = Path("/proc/self/status").read_text()
    return int(re.findall(r"VmHWM:\s+(\d+) kB", status)[0]) << 10
