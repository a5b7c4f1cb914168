"""The pipeline and what it needs, behind ports; it knows no wire, no file and no wall clock."""
