"""The verb `motor_parameters`: from a fitted model, and measured current, a stalled shaft or a data sheet's value, to R, k, J, b.

Voltage and shaft alone tell three numbers, the gain, the time constant and the Coulomb voltage:

    K = k/(R b + k²),   τ + τ₂ = (R J + L b)/(R b + k²),   u_c = T_c R/k

for which there are as many motors as there are resistances. What tells them apart is a second equation of the winding,

    V = R i + L di/dt + k ω

from a measured current, from a stalled shaft (ω = 0), or a value that somebody states.
"""

from servobench.identification.motor_parameters.combination import MotorEstimates as MotorEstimates
from servobench.identification.motor_parameters.combination import motor_parameters as motor_parameters
