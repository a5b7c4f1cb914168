"""Rivers in images: water, banks, centreline and transects."""
