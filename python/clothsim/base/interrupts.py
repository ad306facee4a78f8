"""Ctrl-C takes effect only between two pieces of work, so that a state is whole."""

from __future__ import annotations

import signal
import threading
from typing import Any


class Interrupts:
    """A context that keeps SIGINT back; `deliver_signal` passes it to the previous handler.

    It has no effect outside the main thread, because only the main thread receives signals.
    """

    _handler: Any = None
    _pending: tuple[Any, ...] = ()

    def __enter__(self) -> Interrupts:
        if threading.current_thread() is threading.main_thread() and callable(
            handler := signal.getsignal(signal.SIGINT)
        ):
            self._handler = handler
            signal.signal(signal.SIGINT, self._note_signal)
        return self

    def _note_signal(self, *signal_and_frame: Any) -> None:
        self._pending = signal_and_frame

    def deliver_signal(self) -> None:
        """Call the handler if a signal has come; it raises KeyboardInterrupt by default."""
        pending = self._pending
        self._pending = ()
        if pending:
            self._handler(*pending)

    def __exit__(self, *error: Any) -> None:
        if self._handler:
            signal.signal(signal.SIGINT, self._handler)
            if error[0] is None:
                self.deliver_signal()
