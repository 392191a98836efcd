"""Ctrl-C ends a command at whatever moment it comes.

Python turns SIGINT into the exception KeyboardInterrupt in whatever code is running. In a destructor, or in a callback from C, it
cannot get out: the interpreter prints "Exception ignored in ..." and goes on. Some libraries drop it without a word, or make
another exception of it. Here an interrupt that is no longer on its way is raised again, until it has ended the command.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

AGAIN = 0.1
"""Seconds between two looks at whether an interrupt was lost."""


@contextmanager
def interruptible(last: bool = False) -> Iterator[None]:
    """Within, SIGINT raises KeyboardInterrupt until that has left this context.

    `./tcs` blocks SIGINT before it becomes this process, since nobody could answer it then; from here on it is heard. `last`:
    nothing but the end of the process follows, and SIGINT then ends it at once, without a word. Nothing is changed in threads
    other than the main one, where SIGINT is ignored, and where the program has a handler of its own.
    """
    here = threading.current_thread() is threading.main_thread()
    interrupt = _Interrupt()
    ours = here and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    hook = sys.unraisablehook
    try:
        if ours:
            sys.unraisablehook = interrupt.tell_others(hook)
            signal.signal(signal.SIGINT, interrupt.arrives)
        if here:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        yield
    except Exception as error:
        if interrupt.came:  # what it was raised in has made another exception of it
            raise KeyboardInterrupt from error
        raise
    finally:
        interrupt.over = True  # before anything is called, in whose beginning one more could be raised
        if ours:
            sys.unraisablehook = hook
            if signal.getsignal(signal.SIGINT) == interrupt.arrives:
                signal.signal(signal.SIGINT, signal.SIG_DFL if last else signal.default_int_handler)
        interrupt.forget()


class _Interrupt:
    """A SIGINT and what has become of it. A timer looks after it once it has come."""

    def __init__(self) -> None:
        self.over = False  # it has left the context, or nothing is left to be interrupted
        self.came = False
        self._alarm: Any = None  # the handler of SIGALRM that was there before it came

    def arrives(self, *_: object) -> None:
        """The handler of SIGINT. A second one interrupts also what the first one made the program do."""
        if self.over:
            return
        if not self.came:
            self.came, self._alarm = True, signal.signal(signal.SIGALRM, self._look_after)
        signal.setitimer(signal.ITIMER_REAL, AGAIN, AGAIN)
        raise KeyboardInterrupt

    def _look_after(self, *_: object) -> None:
        """Raise it again unless it is on its way, and what it has ended is being tidied up."""
        on_its_way = sys.exception()
        while on_its_way is not None and not isinstance(on_its_way, KeyboardInterrupt):
            on_its_way = on_its_way.__context__
        if on_its_way is None and not self.over:
            raise KeyboardInterrupt

    def forget(self) -> None:
        """No timer any more."""
        if self.came:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, self._alarm)
            exec("")  # Python kills itself by SIGINT in the end if one was raised in the last text that it executed

    def tell_others(self, hook: Any) -> Any:
        """A hook for exceptions that nobody can catch: of interrupts nothing is said, since they come again."""
        return lambda lost: None if issubclass(lost.exc_type, KeyboardInterrupt) else hook(lost)
