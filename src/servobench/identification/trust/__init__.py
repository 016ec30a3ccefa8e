"""Whether to trust a fit: problems in the data, their explanations, the residuals, and the prediction of other data.

`doubts` and `explanations` are kinds with one file for each. `validation`, `held_out` and `missing_terms` test the fit itself;
`winding` says whether it separates the lag of the winding from a delay.
"""
