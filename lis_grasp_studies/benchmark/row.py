"""The row of a benchmark: what was measured of one plug-in, as JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from lis_grasp.io.json_lines import Row
from lis_grasp.version import __version__
from lis_grasp_studies.benchmark.baselines import baseline_rows, by_variant
from lis_grasp_studies.benchmark.protocol import Protocol
from lis_grasp_studies.benchmark.scores import MEASURES, Score, scores

_VERDICTS = {"losses": "loss", "unclear": "unclear", "equal": "equal", "wins": "win"}


def scores_of(protocol: Protocol, name: str, parts: Mapping[str, Sequence[Row]]) -> list[Score]:
    """Return the scores of a plug-in's rows by tracks, beside the stored baselines."""
    stored, found = baseline_rows(protocol.version), list[Score]()
    for part, rows in parts.items():
        others = {n: of for n, of in by_variant(protocol, part, stored).items() if n != name}
        found += scores(part, MEASURES[protocol.tracks[part].measure], rows, others)
    return found


def benchmark_row(
    protocol: Protocol,
    name: str,
    kind: str,
    parts: Mapping[str, Sequence[Row]],
    found: Sequence[Score],
) -> dict[str, Any]:
    """Return what is published of a plug-in: its losses, then its measures with intervals."""
    sources = {row.get("source", "") for rows in parts.values() for row in rows} - {""}
    return {
        "protocol": protocol.version,
        "objects_digest": protocol.objects,
        "name": name,
        "kind": kind,
        "source": sorted(sources),
        "version": __version__,
        **{
            name: [_facts(score) for score in found if score.verdict == verdict]
            for name, verdict in _VERDICTS.items()
        },
        "tracks": {part: _measures(found, part, rows) for part, rows in parts.items()},
    }


def _measures(found: Sequence[Score], part: str, rows: Sequence[Row]) -> dict[str, Any]:
    own = {(s.measure.name, s.measure.count): s for s in found if s.track == part}
    return {
        "objects": len({row["object"] for row in rows}),
        "failures": sum("failure" in row for row in rows),
        "measures": [
            {
                "measure": score.measure.name,
                "contacts": score.measure.count,
                "unit": score.measure.unit,
                "better": score.measure.better,
                "mean": score.mean,
                "interval": score.interval,
                "objects": score.objects,
                "margin": score.measure.margin.size,
                "margin_source": score.measure.margin.source,
            }
            for score in own.values()
        ],
    }


def _facts(score: Score) -> dict[str, Any]:
    return {
        "track": score.track,
        "measure": score.measure.name,
        "contacts": score.measure.count,
        "unit": score.measure.unit,
        "baseline": score.baseline,
        "objects": score.pairs,
        "difference": score.difference,
        "margin": score.measure.margin.size,
        "p_equal": score.p_equal,
        "detectable": score.detectable,
    }
