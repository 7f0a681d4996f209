"""The one exception of this package."""

from __future__ import annotations


class Error(Exception):
    """What went wrong, in words for a user.

    what: one plain sentence. remedy: what can be done, or "". file, line: where, or "" and 0.
    """

    def __init__(self, what: str, remedy: str = "", file: str = "", line: int = 0) -> None:
        super().__init__(what, remedy, file, line)
        self.what = what
        self.remedy = remedy
        self.file = file
        self.line = line

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}: " if self.line else f"{self.file}: " if self.file else ""
        return place + self.what + (f"; {self.remedy}" if self.remedy else "")
