"""A `flightdepth` command to be killed or starved: python fault_victim.py ROOM ARGUMENTS...

ROOM is how many bytes one file may hold (the system refuses the rest, as a full disk does), or "any".
"""

from __future__ import annotations

import sys


def main() -> None:
    room, *arguments = sys.argv[1:]
    if room != "any":
        import resource
        import signal

        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # else the process would be killed for it
        resource.setrlimit(resource.RLIMIT_FSIZE, (int(room), int(room)))
        sys.dont_write_bytecode = True  # Python keeps what was cut off, and no later process can import it
    from flightdepth import cli

    sys.exit(cli.main(arguments))


if __name__ == "__main__":
    main()
