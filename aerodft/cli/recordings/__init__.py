"""Commands about recordings: played, computed anew, recovered, compared, exported."""
