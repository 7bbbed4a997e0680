"""Kinds of fuzzing cases by name."""

from fuzzing import contact_cases, file_cases, hand_cases, log_cases, mesh_cases
from fuzzing.cases import Kind

# The position of a kind is part of its seeds: add new kinds at the end.
KINDS: dict[str, Kind] = {
    "contacts": contact_cases.KIND,
    "meshes": mesh_cases.KIND,
    "hands": hand_cases.KIND,
    "files": file_cases.KIND,
    "logs": log_cases.KIND,
}
