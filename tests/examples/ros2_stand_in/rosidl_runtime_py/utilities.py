def get_message(kind: str) -> str:
    """Return a type that this ROS has."""
    if kind.startswith("whole_body"):
        raise ModuleNotFoundError(kind)
    return kind
