"""Assessment: a motor of their own for each student, forms to fill in, and marks."""
