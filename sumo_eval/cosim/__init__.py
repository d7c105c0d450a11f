"""Co-simulation: libsumo steps every vehicle, the ADS moves the ego, contact and limits are the harness's own."""
