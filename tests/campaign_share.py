"""How much of its full size a campaign drives."""

import os

SHARE = float(os.environ.get("SUMO_EVAL_CAMPAIGN_SHARE", "1"))
