"""A comparison as rows, as a table, as a picture."""

from __future__ import annotations

import importlib
import re
from difflib import get_close_matches
from typing import Any, Dict, List, Mapping, Optional, Sequence

from ._palpate import Path, Trace
from .errors import Error

COLUMNS = (
    "label", "status", "prepare.total_ms", "memory.bytes", "frame_all.mean_us", "frame_all.p999_us",
    "accuracy.force_rms_n", "accuracy.force_rms_percent", "accuracy.missed_contact_frames",
    "accuracy.false_contact_frames",
)


def _flat(tree: Mapping[str, Any], prefix: str = "") -> Dict[str, Any]:
    row: Dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, dict):
            row.update(_flat(value, prefix + key + "."))
        else:
            row[prefix + key] = value
    return row


def _has(row: Mapping[str, Any], name: str) -> bool:
    """Whether the row has the column, or may have it: a whole group that nothing was measured of is None."""
    parts = name.split(".")
    return name in row or any(row.get(".".join(parts[:n]), "") is None for n in range(1, len(parts)))


def _words(column: str) -> str:
    """frame_all.mean_us: frame all mean, µs."""
    words = column.replace(".", " ").replace("_", " ").replace("rms", "RMS").split()
    unit = {"us": "µs", "ms": "ms", "percent": "%", "n": "N", "mm": "mm", "deg": "°"}.get(words[-1])
    return f"{' '.join(words[:-1])}, {unit}" if unit else " ".join(words)


class Comparison:
    """Results of compare().

    document: as result.json. rows: a dict for each renderer, keys with dots ("accuracy.force_rms_n"), units in
    the keys, None where nothing applies. path, traces: what was walked, and what each label answered.
    """

    def __init__(self, document: Dict[str, Any], path: Path, traces: Dict[str, Trace]) -> None:
        self.document = document
        self.path = path
        self.traces = traces
        self.rows: List[Dict[str, Any]] = [_flat(row) for row in document["renderers"]]

    def table(self, columns: Sequence[str] = COLUMNS) -> Any:
        """A pandas.DataFrame with a row for each renderer; a list of dicts without pandas."""
        chosen = [{name: row.get(name) for name in columns} for row in self.rows]
        try:
            return importlib.import_module("pandas").DataFrame(chosen, columns=list(columns))
        except ImportError:
            return chosen

    def plot(self, x: str = "frame_all.mean_us", y: str = "accuracy.force_rms_percent",
             ax: Optional[Any] = None) -> Any:
        """Draws one column over another, a point for each renderer that has both; matplotlib's Axes."""
        for name in (x, y):
            if not any(_has(row, name) for row in self.rows):
                near = get_close_matches(name, {key for row in self.rows for key in row}, 1)
                raise Error(f"there is no column '{name}'", f"did you mean '{near[0]}'?" if near else "see .rows")
        if ax is None:
            try:
                ax = importlib.import_module("matplotlib.pyplot").subplots()[1]
            except ImportError as missing:
                raise Error("matplotlib is not installed", "install python3-matplotlib, or give ax=") from missing
        drawn = [row for row in self.rows if row.get(x) is not None and row.get(y) is not None]
        for row in drawn:
            ax.plot(row[x], row[y], "o")
            ax.annotate(row["label"], (row[x], row[y]), textcoords="offset points", xytext=(0, 6), ha="center")
        # A logarithm needs numbers above 0.
        for name, set_scale in ((x, ax.set_xscale), (y, ax.set_yscale)):
            if drawn and all(row[name] > 0 for row in drawn):
                set_scale("log")
        ax.margins(x=0.25, y=0.2)  # room for names
        ax.set_xlabel(_words(x))
        ax.set_ylabel(_words(y))
        return ax

    def __repr__(self) -> str:
        table = self.table()
        # Ten columns are wider than a terminal, a few renderers are not.
        return str(table.set_index("label").T.to_string(float_format="{:.4g}".format)
                   if hasattr(table, "set_index") else table)

    def _repr_html_(self) -> Optional[str]:
        table = self.table()
        if not hasattr(table, "to_html"):
            return None
        # Names may be broken where they have a joint, or ten columns are wider than a page.
        return re.sub(r"<th>[^<]*</th>", lambda name: re.sub(r"([._])", r"\1<wbr>", name[0]),
                      str(table.to_html(index=False, float_format="{:.4g}".format, border=0)))


def joined(parts: Sequence[Comparison]) -> Comparison:
    """Comparisons along one path as one; the second row of a label is label-2."""
    traces: Dict[str, Trace] = {}
    rows: Dict[str, Dict[str, Any]] = {}
    for part in parts:
        for row in part.document["renderers"]:
            label, count = row["label"], 2
            while label in rows:
                label, count = f"{row['label']}-{count}", count + 1
            rows[label] = dict(row, label=label)
            if row["label"] in part.traces:
                traces[label] = part.traces[row["label"]]
    return Comparison(dict(parts[0].document, renderers=list(rows.values())), parts[0].path, traces)
