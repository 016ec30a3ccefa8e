"""The kind `studies`: what an exercise computes and shows beside its text, each with tables, figures and facts."""
