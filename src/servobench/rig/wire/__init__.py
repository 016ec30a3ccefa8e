"""The words between the host and the open rig: frames, messages and their table, without a port."""
