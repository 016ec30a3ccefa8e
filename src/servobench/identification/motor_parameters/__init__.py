"""The verb `motor_parameters`: R, k, J and b from a fitted model and a measured current, a stalled shaft or a data sheet's
value.

Voltage and position alone determine three numbers, the gain, the time constant and the Coulomb voltage:

    K = k/(R b + k²),   τ + τ₂ = (R J + L b)/(R b + k²),   u_c = T_c R/k

and every resistance has a motor with these three. A second equation, that of the winding, decides between them:

    V = R i + L di/dt + k ω

It needs a measured current, a stalled shaft (ω = 0), or a value that the user states.
"""

from servobench.identification.motor_parameters.combination import MotorEstimates as MotorEstimates
from servobench.identification.motor_parameters.combination import motor_parameters as motor_parameters
