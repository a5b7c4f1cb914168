"""Use cases, one room each: what a command, a notebook or a page asks for; values out, progress through a callback."""
