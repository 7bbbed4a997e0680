"""Printing of findings: what is fine, and what to fix."""

from __future__ import annotations

from collections.abc import Iterable

from lis_grasp.cli.progress import say
from lis_grasp.robots.hand_check import Finding


def say_findings(findings: Iterable[Finding]) -> None:
    """Print one line for each finding, on stdout."""
    for finding in findings:
        say(f"{'ok  ' if finding.fine else 'FIX '}  {finding.text}")
