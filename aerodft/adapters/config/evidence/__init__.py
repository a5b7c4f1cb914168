"""Evidence files: landmarks, marks and lengths that people know of a scene, for a calibration."""

from aerodft.adapters.config.evidence.cross_checks import StatedObservation
from aerodft.adapters.config.evidence.evidence_file import (
    EvidenceFile,
    Flight,
    ImageEvidence,
    StatedPose,
    check_against,
    landmark_tables,
    load_evidence,
)
from aerodft.adapters.config.evidence.evidence_tables import GEO_KEYS
from aerodft.adapters.config.evidence.local_frame import LocalFrame, takes_degrees
from aerodft.adapters.config.evidence.markers import MarkersFile, load_markers, markers_from
from aerodft.adapters.config.tables import LOCAL
