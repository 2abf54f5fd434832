"""Instants and lengths of time in words."""


def span(seconds: float) -> str:
    """8s, 12m04, 3h05."""
    whole = max(int(seconds), 0)
    if whole < 60:
        return f"{whole}s"
    if whole < 3600:
        return f"{whole // 60}m{whole % 60:02d}"
    return f"{whole // 3600}h{whole % 3600 // 60:02d}"
