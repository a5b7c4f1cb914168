"""The paper's tables and figures, computed anew beside what it prints."""
