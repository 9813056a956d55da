"""Drivers for other people's measurement programs. Each needs the package it is for, and is imported by name."""

from __future__ import annotations

__all__ = ()
