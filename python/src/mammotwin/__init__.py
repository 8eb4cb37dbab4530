"""Reads the results of mammotwin: from breast MRI to mammography metrics.

    import mammotwin
    results = mammotwin.open("runs/demo")
    results.compression.curve["force_n"].plot()

Everything is in millimetres, right-anterior-superior (+x to the person's right, +y to the front, +z to the head), in
the frame of the reference pose unless something else is said. Names end in their units.
"""

from .calibration import Calibration, Moduli, Shared
from .compression import Compression
from .discovery import Candidate, Discovery, Gap, PoseModuli, Score, Second, open_discovery
from .errors import MammotwinError, MissingError, NotResultsError, OptionalPackageError, SchemaError
from .fields import Field
from .folder import StageRecord
from .mesh import Mesh, Surface, Tissue
from .metrics import Metric, Metrics
from .poses import Distances, Pose, PoseFit, Registration
from .radiograph import Radiograph, Technique
from .regions import Region, Site
from .results import SCHEMA_VERSION, Results, open
from .states import Checks, State
from .transform import RigidTransform

__version__ = "0.1.0"
__all__ = [
    "SCHEMA_VERSION",
    "Calibration",
    "Candidate",
    "Checks",
    "Compression",
    "Distances",
    "Discovery",
    "Field",
    "Gap",
    "MammotwinError",
    "Mesh",
    "Metric",
    "Metrics",
    "MissingError",
    "Moduli",
    "NotResultsError",
    "OptionalPackageError",
    "Pose",
    "PoseFit",
    "PoseModuli",
    "Radiograph",
    "Region",
    "Registration",
    "Results",
    "RigidTransform",
    "SchemaError",
    "Score",
    "Second",
    "Site",
    "StageRecord",
    "State",
    "Surface",
    "Technique",
    "Tissue",
    "open",
    "open_discovery",
]
