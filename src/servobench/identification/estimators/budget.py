"""The budget of uncertainty: where the width of an interval comes from, line by line (JCGM 100:2008, section 8 of its budget).

The estimator's own covariance is the first line. Everything that widens the intervals after the fit adds a line, and a
covariance grows only here. So the stated covariance is the sum of the lines, and the user sees its parts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from servobench.core.channels import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Contribution:
    """One line of the budget: what it comes from, the covariance (P, P) that it adds, and why.

    `freedom` is the number of degrees of freedom that the covariance was found with, infinite where it isn't estimated.
    """

    source: str
    """The source, in a few words."""
    covariance: Array
    reason: str
    """The reason, as a part of a sentence."""
    freedom: float = np.inf


def beyond(target: Array, already: Array) -> Array:
    """Return the smallest covariance (P, P) that makes `already` no smaller than `target` in any direction.

    That is the positive part of their difference, in units of the standard deviations of the target, so that units don't
    matter. Parameters of which either says nothing (infinite) get nothing.
    """
    sd = np.sqrt(np.maximum(np.diag(target), np.diag(already)))
    finite = np.isfinite(sd) & (sd > 0)
    part = np.ix_(finite, finite)
    scale = np.outer(sd[finite], sd[finite])
    values, vectors = np.linalg.eigh((target[part] - already[part]) / scale)
    out = np.zeros_like(target)
    out[part] = (vectors * np.maximum(values, 0.0)) @ vectors.T * scale
    return out
