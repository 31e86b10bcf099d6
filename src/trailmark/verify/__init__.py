"""The verifier: is a path free, with what does it collide, how near does it come; whoever planned it."""

from trailmark.verify.auditor import Collision, PathAudit, PathAuditor, Undrivable, check_path, repaired
from trailmark.verify.verifier import RIM, Verifier

__all__ = ["RIM", "Collision", "PathAudit", "PathAuditor", "Undrivable", "Verifier", "check_path", "repaired"]
