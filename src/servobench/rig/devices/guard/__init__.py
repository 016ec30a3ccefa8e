"""The kind `monitors`: checks of each sample of a guarded device that decide when the motor must be stopped."""
