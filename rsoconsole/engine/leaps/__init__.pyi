from .leaping import LEAP_POLL_NS as LEAP_POLL_NS
from .leaping import Leaping as Leaping
from .pass_entry import entry_of as entry_of
