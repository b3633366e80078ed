"""What is said where an arm was under way and its stop was not answered: the cause, and that it may still be moving."""

from __future__ import annotations

from surfuse.errors import DeviceError, InterruptError, SurfuseError

AT_CONTROLLER = "the arm may still be moving, stop it at its controller"
UNANSWERED = f"the stop was not answered: {AT_CONTROLLER}"
UNABLE = f"the bridge cannot 'stop': {AT_CONTROLLER}"


def unstopped(cause: BaseException, words: str) -> BaseException:
    """The error that ended a move, with words on the arm; Ctrl-C becomes an error that can carry them."""
    if isinstance(cause, SurfuseError):
        return type(cause)(f"{cause.what}; {words}", cure=cause.cure, where=cause.where)
    if isinstance(cause, KeyboardInterrupt):
        return InterruptError(f"interrupted in a move; {words}")
    return cause


def unanswered_move(lost: DeviceError, after: DeviceError, stop_asked: bool) -> DeviceError:
    """A move of which nobody knows how it ended, as the question after it was not answered either."""
    words = UNANSWERED if stop_asked else f"then {after.what}: {AT_CONTROLLER}"
    slow = ", and raise move_timeout_s if the arm is slow" if stop_asked else ""
    return DeviceError(f"{lost.what}; {words}", where=lost.where, cure=f"check that the bridge still runs{slow}")
