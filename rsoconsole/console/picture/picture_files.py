"""The small pictures of a frame, as its session keeps them."""

from rsoconsole.console.picture.marks import marks_of
from rsoconsole.console.picture.picture import ByteImage, Picture, light_of, read_codes
from rsoconsole.night import NightFrame
from rsoconsole.session.reading import SessionReader


def read_picture(reader: SessionReader, frame_id: int, detail: NightFrame) -> Picture | None:
    """The frame's picture with what was said of it; None where none is kept, or not yet.

    Raises SessionError.
    """
    path = reader.preview_path(frame_id)
    codes = read_codes(path) if path is not None else None
    if codes is None:
        return None
    return Picture(
        frame_id=frame_id,
        codes=codes,
        light=light_of(codes),
        detail=detail,
        marks=marks_of(detail),
        closeup=read_closeup(reader, detail),
        place=detail.closeup,
    )


def read_closeup(reader: SessionReader, detail: NightFrame) -> ByteImage | None:
    """The piece at full resolution; None where none is kept, or not yet. Raises SessionError."""
    if detail.closeup is None:
        return None
    path = reader.closeup_path(detail.closeup.frame_id)
    return read_codes(path) if path is not None else None
