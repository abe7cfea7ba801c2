"""Plans of manoeuvres: what they trade against each other, drawn cases, pictures."""

from drm_baselines.planning.cases import CaseResult, Proof, draw_case, fly_cases
from drm_baselines.planning.trade import TRADED, front, rows

__all__ = ["TRADED", "CaseResult", "Proof", "draw_case", "fly_cases", "front", "rows"]
