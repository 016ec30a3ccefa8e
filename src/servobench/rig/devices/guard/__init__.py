"""The kind `monitors`: what looks at each sample of a guarded device and says when it must not go on."""
