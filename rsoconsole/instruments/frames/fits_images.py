"""One image of a FITS file: read here where it is plain, else by the decoding process."""

from rsoconsole.errors import FrameError
from rsoconsole.instruments.frames.fits_structure import structure_fault
from rsoconsole.instruments.frames.frame_decoder import decoder
from rsoconsole.instruments.frames.plain_fits import Content, FitsImage, read_plain


def fits_image(
    content: Content, name: str, extension: str | None = None, min_side_px: int = 1
) -> FitsImage:
    """The image asked for; with None the file's first.

    ``extension`` is a number (0 is the primary unit), a name (EXTNAME) or ``NAME,VERSION``.
    Images with a side below ``min_side_px`` count only where there are no others. What is no
    plain file is decoded in another process. Raises FrameError.
    """
    fault = structure_fault(content)
    if fault is not None:
        raise FrameError(f"{name} is damaged: {fault} cannot be; copy it again or leave it out")
    plain = read_plain(content)
    if plain is not None and extension in (None, "0"):
        return FitsImage(raw=plain[0], header=plain[1])
    return decoder().decode(content, name, extension, min_side_px)
