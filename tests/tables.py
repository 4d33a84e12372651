"""Tables that one test goes through, where a test for each row would cost more than the row itself."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from functools import wraps
from typing import Any

from servolink.testing import run


def over(names: str, rows: Iterable[object]) -> Callable[[Callable[..., Any]], Callable[..., None]]:
    """Call a test with each row in turn; an error has a note with the row. Coroutines run in virtual time of their own.

    Args:
        names: parameters of the test, separated by commas.
        rows: one value each for a single name, tuples for several. The fixtures of the test are the same for all.
    """
    keys = names.replace(" ", "").split(",")
    table = [dict(zip(keys, row if isinstance(row, tuple) and len(keys) > 1 else (row,), strict=True)) for row in rows]

    def decorate(test: Callable[..., Any]) -> Callable[..., None]:
        is_coroutine = inspect.iscoroutinefunction(test)

        @wraps(test)
        def all_rows(*args: Any, **fixtures: Any) -> None:
            assert table, "the table has no rows"
            for row in table:
                try:
                    done = test(*args, **fixtures, **row)
                    if is_coroutine:
                        run(done)
                except Exception as error:
                    error.add_note(f"in the row {row}")
                    raise

        signature = inspect.signature(test)
        kept = [each for name, each in signature.parameters.items() if name not in keys]
        all_rows.__signature__ = signature.replace(parameters=kept)  # type: ignore[attr-defined]
        return all_rows

    return decorate
