"""Signals, linear systems and control laws in theory, without a device, data or uncertainty.

`transfer_function` is the noun, `first_order` the motor that controllers are tuned for. `responses`, `margins`, `sampled_loop`
and `stability` analyse a system, alone and in a loop; `interop` converts it to other libraries and back. `signals`, `control`
and `tuning` are kinds with a file for each member, `filters` is about the effect of a filter on a speed computed from counts.
It uses `core`.

Public: `TransferFunction`, `stability`, the signals, `to_control`, `from_control`, `to_scipy`, `from_scipy`.
"""
