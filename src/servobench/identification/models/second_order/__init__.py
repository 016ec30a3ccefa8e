"""The motor with the lag of its winding: structures, their exact response with friction on the shaft, and guesses."""

from servobench.identification.models.second_order.structure import SecondOrder as SecondOrder
