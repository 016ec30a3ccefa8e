"""Trust in the figures: model error from the data and from experience, and the state of each parameter.

It works on a finished fit, from its Jacobian and its innovations, and adds lines to the fit's budget. It may use estimators and
everything below them; verdict and sentences are made above it.
"""
