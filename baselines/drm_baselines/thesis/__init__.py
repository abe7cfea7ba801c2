"""What the thesis publishes, computed again: tables, figures, claims and errata.

``published.json`` holds what the thesis states, `entries` what is computed for it, and `reproduce`
writes pictures, a table of verdicts and one page. The mechanics come from ``drm_env``; only test
beams that are not the arm (appendices B and E) are computed here.
"""

from __future__ import annotations

from drm_baselines.support.extras import needing

with needing("the thesis' tables and figures", "evaluate"):
    from drm_baselines.thesis.catalogue import entries, select
    from drm_baselines.thesis.results import Entry, Outcome, Row, Verdict
    from drm_baselines.thesis.writing import write_results

__all__ = ["Entry", "Outcome", "Row", "Verdict", "entries", "select", "write_results"]
