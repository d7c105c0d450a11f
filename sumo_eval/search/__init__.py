"""Where in a space one ADS begins to collide: an ask-and-tell search, and its run through SUMO."""
