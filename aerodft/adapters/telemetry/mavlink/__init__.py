"""MAVLink: bytes framed strictly, messages decoded, links opened."""
