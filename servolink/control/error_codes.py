"""Errors of the control interface: a code and a remedy for each kind of error."""

from __future__ import annotations

from enum import IntEnum
from typing import Annotated, Any

from msgspec import UNSET, Meta, Struct, UnsetType

from servolink import errors
from servolink.errors import EncodeError, Reason, RequestError, RequestRefused, ServolinkError, escape


class Code(IntEnum):
    """Codes of errors from outside the library: those of JSON-RPC 2.0, and two of the hub."""

    PARSE_ERROR = -32700
    INVALID_REQUEST = -32600
    METHOD_NOT_FOUND = -32601
    INVALID_PARAMS = -32602
    INTERNAL_ERROR = -32603
    BUSY = -32000
    FORBIDDEN = -32001


REMEDIES = {
    Code.PARSE_ERROR: "send one JSON object a message, in UTF-8 and at most 1 MiB",
    Code.INVALID_REQUEST: "send jsonrpc, method, params (an object) and id; batches are not supported",
    Code.METHOD_NOT_FOUND: "use a method of this reference",
    Code.INVALID_PARAMS: "correct the params; `path` says where",
    Code.INTERNAL_ERROR: "report the defect of the hub; the log of the hub has the details",
    Code.BUSY: "wait for responses before sending more; a stop is always carried out",
    Code.FORBIDDEN: "connect with a higher role",
}
"""What to do about each of these errors, unless the error itself knows better."""


class Kind(Struct, frozen=True):
    """An error of the library."""

    code: int
    error: type[ServolinkError]
    remedy: str


KINDS = (
    Kind(1, errors.ServolinkError, "read the message"),
    Kind(100, errors.TransportError, "check the hub's connection to the board"),
    Kind(101, errors.TransportUnavailable, "install what the message names, or correct the address"),
    Kind(102, errors.InvalidAddress, "correct the address"),
    Kind(103, errors.ProfileError, "repair the profile of the board: `servolink board show`"),
    Kind(104, errors.OpenError, "follow the remedy in the message"),
    Kind(105, errors.ConnectionLost, "wait for the notification `connection`; nothing is sent twice"),
    Kind(200, errors.PacketError, "correct the value that the message names"),
    Kind(201, errors.EncodeError, "correct the value that the message names; nothing was sent"),
    Kind(202, errors.MotionRefused, "nothing moved: stay within the limits, or take the lease"),
    Kind(203, errors.DecodeError, "look for damage on the line: `servolink doctor`"),
    Kind(300, errors.RequestError, "read the message"),
    Kind(301, errors.RequestTimeout, "ask again: the request changed nothing"),
    Kind(302, errors.Rejected, "the board refused; the message says why that may be"),
    Kind(303, errors.NotFound, "list what is there: `servos.list`, `records.list`"),
    Kind(304, errors.AmbiguousName, "give the id instead of the caption"),
    Kind(305, errors.WrongBoard, "connect the right board"),
    Kind(306, errors.OutcomeUnknown, "read the state back before sending again: the board may have obeyed"),
    Kind(307, errors.RequestRefused, "read `reason` and the message: nothing was sent, or a stop ended the request"),
    Kind(308, errors.ServoStalled, "look at the robot and free the servo; then start the servos again"),
    Kind(400, errors.ProjectError, "correct the project; the message says where"),
    Kind(401, errors.RecordingError, "follow the message; `recorder.status` describes the recording"),
    Kind(402, errors.TwinError, "correct the figure, or install MuJoCo; the message says what to do"),
    Kind(500, errors.TargetNotReached, "the motion was sent: look at the robot, and do not simply repeat it"),
)
"""One code for each kind of error of the library."""

_KINDS = {kind.error: kind for kind in KINDS}


class ErrorData(Struct, frozen=True):
    """The `data` of an error."""

    kind: Annotated[str, Meta(description="name of the error, such as MotionRefused")]
    remedy: Annotated[str, Meta(description="what to do next")]
    path: Annotated[str, Meta(description="where in the params the wrong value is, such as targets.hip")] = ""
    reason: Annotated[str, Meta(description="for programs, such as `limit`, `lease` or `stop`; else `other`")] = "other"
    basis: Annotated[dict[str, str] | UnsetType, Meta(description="of a forecast: origin of its values")] = UNSET


class ErrorObject(Struct, frozen=True):
    """The `error` of a response."""

    code: int
    message: Annotated[str, Meta(description="for people; control and bidi characters are escaped")]
    data: ErrorData

    @classmethod
    def of(cls, error: Exception) -> ErrorObject:
        """Return `error` as programs get it."""
        text = escape(str(error))
        if isinstance(error, RpcError):
            return cls(error.code, text, ErrorData(error.code.name.lower(), error.remedy, escape(error.path)))
        if isinstance(error, ServolinkError):
            kind = next(_KINDS[each] for each in type(error).__mro__ if each in _KINDS)
            remedy = getattr(error, "remedy", "") or kind.remedy
            path = error.path if isinstance(error, EncodeError) else ""
            basis = getattr(error, "basis", None) or UNSET
            return cls(kind.code, text, ErrorData(kind.error.__name__, remedy, path, error.reason, basis))
        if isinstance(error, (TypeError, ValueError)):  # what the library says of an impossible argument
            return cls.of(RpcError(Code.INVALID_PARAMS, text))
        return cls.of(RpcError(Code.INTERNAL_ERROR, f"internal error: {type(error).__name__}"))

    def as_error(self, before: str = "") -> ServolinkError:
        """Return the error of the library for this error of a hub, with `before` put before the text."""
        text = before + self.message
        if self.data.kind == "forbidden":
            return RequestRefused(text, reason=Reason.ROLE)
        declared = getattr(errors, self.data.kind, None)
        if isinstance(declared, type) and issubclass(declared, ServolinkError):
            return declared(text, reason=Reason(self.data.reason))
        return RequestError(text)


class RpcError(Exception):
    """Request answered with an error from outside the library."""

    def __init__(
        self, code: Code, text: str, *, path: str = "", remedy: str = "", request_id: int | str | None = None
    ) -> None:
        """Answer the request `request_id`, None if it is unknown, with `code` and `text`."""
        super().__init__(text)
        self.code = code
        self.path = path
        self.remedy = remedy or REMEDIES[code]
        self.request_id = request_id


def is_defect(error: Exception) -> bool:
    """Return whether the hub, not the request, is to blame."""
    expected: tuple[Any, ...] = (RpcError, ServolinkError, TypeError, ValueError)
    return not isinstance(error, expected)
