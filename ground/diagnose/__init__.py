"""Diagnosis: refit, locate, name, model, verify."""
