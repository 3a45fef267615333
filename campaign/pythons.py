"""Which Python has the packages that the commands need; on Debian and Ubuntu that is /usr/bin/python3."""

import importlib.util
import os
import sys

#: The oldest Python, and the packages that the analysis needs.
OLDEST = (3, 11)
PACKAGES = ("numpy", "scipy", "pandas", "h5py", "matplotlib")
SYSTEM = "/usr/bin/python3"
#: Set in a process that was started by `go_on_with_packages`.
MARK = "GRAIN_SCATTER_PYTHON"


def missing_package(name: str) -> str:
    """Return one line on a package that this Python lacks, and what helps."""
    return (
        f"{name} is not installed for {sys.executable}; `{sys.executable} -m pip install {' '.join(PACKAGES)}` "
        f"installs what is needed, or on Debian and Ubuntu `make setup` for {SYSTEM}"
    )


def lacking() -> str:
    """Return why this Python cannot be used, in a few words; "" if it can."""
    if sys.version_info < OLDEST:
        return "is Python %d.%d, and %d.%d is needed" % (*sys.version_info[:2], *OLDEST)  # noqa: UP031
    missing = [name for name in PACKAGES if importlib.util.find_spec(name) is None]
    return f"has no {missing[0]}" if missing else ""


def go_on_with_packages(module: str) -> None:
    """Start `-m module` again with the system's Python, with a note, if this Python lacks something and is another one.

    If that cannot help, an old Python ends the process with one line; a missing package is reported where it is needed,
    since some commands need none.
    """
    if not (lack := lacking()):
        return
    if not os.environ.get(MARK) and os.path.exists(SYSTEM) and not os.path.samefile(SYSTEM, sys.executable):
        print(f"note: {sys.executable} {lack}; {SYSTEM} is used", file=sys.stderr, flush=True)
        os.environ[MARK] = sys.executable
        os.execv(SYSTEM, [SYSTEM, "-m", module, *sys.argv[1:]])
    if sys.version_info < OLDEST:
        sys.exit(f"campaign: {sys.executable} {lack}")
