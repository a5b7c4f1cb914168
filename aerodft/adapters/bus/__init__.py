"""The bus: measurements published, questions answered, observations taken, over zenoh."""

from aerodft.adapters.bus.queries import StationQueries
from aerodft.adapters.bus.session import session_on
from aerodft.adapters.bus.station import ZenohBus
