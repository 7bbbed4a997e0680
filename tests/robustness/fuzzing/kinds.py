"""All kinds of cases by name."""

from fuzzing import contact_cases, file_cases, hand_cases, mesh_cases
from fuzzing.cases import Kind

# The order numbers the kinds, and with it the random numbers of their cases: add at the end.
KINDS: dict[str, Kind] = {
    "contacts": contact_cases.KIND,
    "meshes": mesh_cases.KIND,
    "hands": hand_cases.KIND,
    "files": file_cases.KIND,
}
