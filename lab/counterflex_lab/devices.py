"""Controllers and force sensor that faults are injected into: KUKA RSI, ABB EGM and ATI Net F/T.

The laboratory takes them apart on both sides of the wire. It is the only place outside the makers' folders that names
their parts, and this module the only one of it.
"""

from counterflex.integrations.abb.link.guidance_link import (
    EgmGuidanceLink as EgmGuidanceLink,
    GuidanceSettings as GuidanceSettings,
    Phase as Phase,
)
from counterflex.integrations.abb.link.link import (
    LARGEST_DATAGRAM as LARGEST_MESSAGE,
    EgmForce as EgmForce,
    EgmLink as EgmLink,
)
from counterflex.integrations.abb.link.path_link import EgmPathLink as EgmPathLink
from counterflex.integrations.abb.link.telegram import MESSAGES as MESSAGES
from counterflex.integrations.abb.simulated import EgmContext as EgmContext, FakeEgm as FakeEgm
from counterflex.integrations.ati.link import telegram as netft
from counterflex.integrations.ati.link.link import NetftLink as NetftLink
from counterflex.integrations.ati.link.telegram import Scaling as Scaling
from counterflex.integrations.ati.simulated import COUNTS as COUNTS, SATURATED as SATURATED, NetftServer as NetftServer
from counterflex.integrations.kuka.link.config import (
    RsiConfig as RsiConfig,
    parse_config as parse_config,
    read_config as read_config,
)
from counterflex.integrations.kuka.link.kernel import OK as OK
from counterflex.integrations.kuka.link.link import RsiLink as RsiLink
from counterflex.integrations.kuka.link.make.files import RsiFiles as RsiFiles
from counterflex.integrations.kuka.link.telegram import (
    LARGEST_DATAGRAM as LARGEST_DATAGRAM,
    answer_reader as answer_reader,
    answer_writer as answer_writer,
)
from counterflex.integrations.kuka.link.whole_setup import OnlineLimits as OnlineLimits
from counterflex.integrations.kuka.simulated import FakeRsi as FakeRsi, RsiContext as RsiContext

__all__ = ["LARGEST_MESSAGE", "netft"]
