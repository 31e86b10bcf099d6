"""The extended Kalman filter of a pose and of features, with its motion and sensor models."""
