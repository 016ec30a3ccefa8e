"""Signals, linear systems and control laws on paper: nothing here turns, measures or is uncertain about a motor.

`transfer_function` is the noun, `first_order` the motor that controllers are tuned for. `responses`, `margins`, `sampled_loop`
and `stability` say how a system behaves, alone and in a loop; `interop` hands it to other libraries and back. `signals`,
`control` and `tuning` are kinds with a file for each member, `filters` is what a filter does to a speed made of counts. It uses
`core`.

Public: `TransferFunction`, `stability`, the signals, `to_control`, `from_control`, `to_scipy`, `from_scipy`.
"""
