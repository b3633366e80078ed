"""The judgement of what was found: held-out readings, rival explanations, plain surfaces."""
