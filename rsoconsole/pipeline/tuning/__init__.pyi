from .proposal import propose as propose
from .propose_evidence import Proposal as Proposal
from .propose_evidence import Soundness as Soundness
