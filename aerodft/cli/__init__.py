"""The command line: one file a command, thin; the only place where ports meet adapters."""
