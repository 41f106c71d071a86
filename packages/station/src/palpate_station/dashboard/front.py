"""The process that accepts the server's connections and passes them on: a script by itself.

``front.py LISTENING CHANNEL LIMIT`` with the file descriptors of a listening TCP socket and of a
Unix socket, and the number of connections a second that are passed on besides stops. It ends with
its standard input.

A process of its own, because in the server each system call waits for the threads that compute.
While clients reconnected without pause, connections waited there until their queue overflowed, and
a STOP took up to 1.8 s (`benchmarks/stop_flood.py`).
"""

import select
import signal
import socket
import sys
import time
from collections import deque

#: Paths of the stop requests, for the page and for the API.
STOP_PATHS = frozenset({"/stop", "/api/stop", "/api/v1/stop"})
_STOP_STARTS = tuple(f"POST {path} ".encode() for path in STOP_PATHS)
_START_BYTES = max(map(len, _STOP_STARTS))
#: Time after which a system that is out of file descriptors or memory is asked again, seconds.
_RETRY_S = 0.05


def is_stop(connection: socket.socket) -> bool | None:
    """Return whether a connection begins with a stop; None if it is closed already."""
    try:
        return connection.recv(_START_BYTES, socket.MSG_PEEK).startswith(_STOP_STARTS)
    except BlockingIOError:
        return False
    except OSError:
        return None


def main() -> None:
    """Accept connections until the standard input ends."""
    # Ctrl-C ends the server, which needs its connections until then.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    listening, channel = (socket.socket(fileno=int(number)) for number in sys.argv[1:3])
    listening.setblocking(False)
    channel.setblocking(True)
    passed_s = deque[float](maxlen=int(sys.argv[3]))
    while sys.stdin not in select.select([listening, sys.stdin], [], [])[0]:
        try:
            connection, _ = listening.accept()
        except (BlockingIOError, ConnectionError):
            continue
        except OSError:
            time.sleep(_RETRY_S)
            continue
        with connection:
            connection.setblocking(False)
            begins_with_stop = is_stop(connection)
            if begins_with_stop is None:
                continue
            if not begins_with_stop:
                now_s = time.monotonic()
                if len(passed_s) == passed_s.maxlen and now_s - passed_s[0] < 1.0:
                    continue
                passed_s.append(now_s)
            if sys.platform != "win32":
                socket.send_fds(channel, [b"."], [connection.fileno()])


if __name__ == "__main__":
    main()
