"""Every kind of file that a stranger may give."""

from __future__ import annotations

from tests.fuzz.kinds.analysis import ANALYSIS_KINDS
from tests.fuzz.kinds.imports import IMPORT_KINDS
from tests.fuzz.kinds.runtime import RUNTIME_KINDS
from tests.fuzz.kinds.sessions import SESSION_KINDS
from tests.fuzz.kinds.texts import TEXT_KINDS

KINDS = {
    kind.name: kind
    for kind in (*SESSION_KINDS, *ANALYSIS_KINDS, *TEXT_KINDS, *IMPORT_KINDS, *RUNTIME_KINDS)
}
