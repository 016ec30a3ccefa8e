"""Whether a fit is to be trusted: what is odd in the data, what explains it, what the model leaves over, and what it predicts.

`doubts` and `explanations` are kinds with one file for each. `validation`, `held_out` and `missing_terms` test the fit itself;
`winding` says whether it tells the lag of the winding from a delay.
"""
