"""Applications of a fitted model: model files, prediction, compensation, verification, exports."""
