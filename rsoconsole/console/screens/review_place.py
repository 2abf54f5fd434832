"""Where on the time line a review is, and the words for it."""

from rsoconsole.console.screens.review_moves import ReviewMoves
from rsoconsole.console.screens.review_seat import FOUND, ReviewSeat
from rsoconsole.console.timeline import Place, place_words, reading_words, speed_words


def place_of(review: ReviewSeat, moves: ReviewMoves) -> Place:
    """The wanted moment, the kept moment, and what is jumped to."""
    return Place(
        seq=review.seq,
        words=tuple(word for word in _words(review, moves) if word),
        kept_seq=review.kept.seq if review.kept is not None else None,
        kinds=moves.kinds if review.kind != FOUND else (),
        found=moves.found,
    )


def _words(review: ReviewSeat, moves: ReviewMoves) -> list[str]:
    if review.folder is None:
        return ["no session"]
    moment, timeline = review.moment, review.timeline
    is_there = moment is not None and moment.seq == review.seq
    t_utc_ns = review.night.last_utc_ns if is_there else timeline.time_of(review.seq)
    speed = speed_words(review.player.speed)
    pace = f"{'play' if review.player.is_playing else 'paused'} {speed}"
    if review.is_at_head:
        pace = "follows the live night"
    partly = "" if moment is None or moment.is_whole else "earlier frames still to come"
    kept = "" if review.kept is None else "A " + place_words(timeline, review.kept.seq, None)[0]
    return [
        *place_words(timeline, review.seq, t_utc_ns),
        pace,
        reading_words(timeline),
        partly,
        moves.kind_words,
        kept,
    ]
