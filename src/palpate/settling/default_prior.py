"""What `relaxation` holds possible: spread decays, and the paper's own sensor."""

from __future__ import annotations

from palpate.settling.prior import mixture
from palpate.settling.published_prior import PUBLISHED_PRIOR
from palpate.settling.spread_prior import SPREAD_PRIOR

DEFAULT_PRIOR = mixture([SPREAD_PRIOR, PUBLISHED_PRIOR])
