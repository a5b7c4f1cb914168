"""Other tools' recordings as input: MAVLink, images and cameras in any MCAP file."""
