"""The commands of `jgait`, one in each file; `jgait.cli` combines them. They need the extra `cli`."""

import os
from pathlib import Path


def programs_folder() -> Path:
    """The folder of compiled programs. It is asked for before JAX is imported, so no module of jgait is needed."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "jgait" / "compiled"
