from rigctl.api import ConnectedRig as ConnectedRig
from rigctl.api import analyse as analyse
from rigctl.api import connect as connect
from rigctl.api import encode as encode
from rigctl.api import open_session as open_session
from rigctl.errors import RigctlError as RigctlError

__version__: str
