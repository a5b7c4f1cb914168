"""Setting up one's own station: cameras that are known, and first station files."""

from aerodft.app.setup.cameras import find_cameras, write_camera
from aerodft.app.setup.drafting import StationDraft, draft_station
