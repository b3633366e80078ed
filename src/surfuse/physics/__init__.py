"""Constants of nature that estimators, drivers and the twin share: nothing that anybody could be wrong about alone."""
