"""Real2Sim2Real, the paper's loop: learn the sensor, simulate with it, train detectors, score them on real clouds."""
