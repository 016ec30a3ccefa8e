"""Rational transfer functions of any order: the structure, its exact response, and guesses by refined instrumental variables."""

from servobench.identification.models.rational.structure import Rational as Rational
from servobench.identification.models.rational.structure import rational as rational
