"""Parts of `bench/causes.py`: plain motors, the real recordings, and what each is told."""
