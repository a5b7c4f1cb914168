"""The table of a point of the measured plane, from which stations and flights count their places."""

from aerodft.adapters.config import keys
from aerodft.adapters.config.tables import Table


class OriginTable(Table):
    """A point of the measured plane."""

    lat_deg: keys.Latitude
    lon_deg: keys.Longitude
    alt_msl_m: keys.Real | None = None
