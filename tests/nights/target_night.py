"""A night of ``demo --target`` for one catalogued object, with the truth that it is judged by."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from rsoconsole.base import ConfigError
from rsoconsole.cli.demo._demo_targets import config_for_plan, plan_targets
from rsoconsole.cli.demo.demo import demo_config
from rsoconsole.cli.demo.demo_night import SimulatedNight, run_night
from rsoconsole.cli.judge import summary
from rsoconsole.config import Config
from rsoconsole.records import Measurement, Site
from rsoconsole.session import SessionReader
from rsoconsole.simulator import NightPlan
from rsoconsole.simulator.mount.mount_model import MountModel
from rsoconsole.simulator.server import ObservatorySettings, make_observatory_setup
from rsoconsole.sky import icrs_to_jnow, jnow_to_icrs, separation_deg, times
from tests.orbits.test_places import skyfield_site, skyfield_timescale
from tests.truth.regimes import Sample

INDEX = Path(__file__).resolve().parents[2] / ".cache/index/usr/share/astrometry"
SITES = (
    Site(latitude_deg=29.19, longitude_deg=-81.05, elevation_m=10.0),
    Site(latitude_deg=52.2, longitude_deg=21.0, elevation_m=110.0),
    Site(latitude_deg=-30.2, longitude_deg=-70.7, elevation_m=2200.0),
    Site(latitude_deg=-31.3, longitude_deg=149.1, elevation_m=1100.0),
    Site(latitude_deg=20.7, longitude_deg=-156.3, elevation_m=3000.0),
    Site(latitude_deg=28.8, longitude_deg=77.0, elevation_m=200.0),
)


def config_at(site: Site, file: Path) -> Config:
    """The demo's configuration with the whole sky's stars."""
    config = demo_config(site, preset="tuned", keep_frames="none", catalogue=[file])
    solver = config.solver.model_copy(update={"index_dirs": (INDEX,)})
    return config.model_copy(update={"solver": solver})


def plan_of(sample: Sample, frames: int, seed: int = 1) -> tuple[NightPlan, Config]:
    """The plan from the first site at which the object has a night at all."""
    refusals = []
    for site in SITES:
        config = config_at(site, sample.file)
        try:
            wanted = [str(sample.entry.norad_id)]
            plan = plan_targets(wanted, config, at=None, seed=seed, frames=frames)
        except ConfigError as error:
            refusals.append(str(error))
            continue
        return plan, config_for_plan(config, plan)
    raise AssertionError("; ".join(refusals))


@dataclass(frozen=True)
class Judged:
    """A night that was run."""

    plan: NightPlan
    truth: list[dict[str, Any]]
    figures: dict[str, Any]

    def of_target(self, exposure: int) -> dict[str, Any] | None:
        """The truth of the target in one exposure."""
        each = self.truth[exposure]["satellites"]
        return next((s for s in each if s["norad_id"] == self.plan.targets[0]), None)


def judged(sample: Sample, session: Path, frames: int, patch: pytest.MonkeyPatch) -> Judged:
    """Run it as the demo does, and keep the truth."""
    plan, config = plan_of(sample, frames)
    kept: list[dict[str, Any]] = []
    read = summary.read_truth

    def keeping(path: Path) -> list[dict[str, Any]]:
        kept.extend(read(path))
        return list(kept)

    patch.setattr(summary, "read_truth", keeping)
    night = SimulatedNight(
        scenario=plan.title,
        seed=1,
        speed=0.0,
        frames=frames,
        session=session,
        plan=plan.to_table(),
    )
    return Judged(plan, kept, run_night(config, night))


def off_skyfield_arcsec(sample: Sample, true: dict, site: Site, t_utc_ns: int, earth: Any) -> float:
    """Distance of a true place from skyfield's."""
    from skyfield.api import EarthSatellite

    timescale = skyfield_timescale(t_utc_ns)
    instant = timescale.tt_jd(*(float(part) for part in times.jd_tt(t_utc_ns)))
    theirs = EarthSatellite.from_satrec(sample.entry.record, timescale)
    ra, dec, _ = (earth + skyfield_site(site)).at(instant).observe(earth + theirs).radec()
    place = (true["ra_icrs_deg"], true["dec_icrs_deg"])
    return float(separation_deg(*place, ra._degrees, dec.degrees)) * 3600.0


def off_target_arcsec(session: Path, run: Judged) -> list[float]:
    """Distance of what was measured nearest to the target in each frame, by astropy."""
    from astropy.coordinates import SkyCoord

    measured: dict[int, list[tuple[float, float]]] = {}
    for _, _, record in SessionReader(session).records(kinds=(Measurement,)):
        place = (record.ra_icrs_deg, record.dec_icrs_deg)
        measured.setdefault(record.frame_id, []).append(place)
    found = []
    for frame_id, places in measured.items():
        true = run.of_target(frame_id - 1)
        if true is not None:
            there = SkyCoord(true["ra_icrs_deg"], true["dec_icrs_deg"], unit="deg")
            found.append(float(there.separation(SkyCoord(places, unit="deg")).arcsec.min()))
    return found


def centre_offset_deg(exposure: dict, true: dict) -> float:
    """How far the target truly was beside the boresight."""
    boresight = exposure["boresight_ra_icrs_deg"], exposure["boresight_dec_icrs_deg"]
    return float(separation_deg(*boresight, true["ra_icrs_deg"], true["dec_icrs_deg"]))


def first_exposure(plan: NightPlan, latency_s: float, seed: int = 1) -> dict[str, Any]:
    """The truth of the exposure that the telescope takes where its mount stands at the start."""
    settings = ObservatorySettings(scenario=plan.title, seed=seed, speed=0.0, plan=plan.to_table())
    stage = make_observatory_setup(settings)
    ra_date_deg, dec_date_deg = icrs_to_jnow(
        stage.start_ra_icrs_deg, stage.start_dec_icrs_deg, stage.t_start_utc_ns
    )
    mount = MountModel(
        latitude_deg=stage.site.latitude_deg,
        longitude_deg=stage.site.longitude_deg,
        seed=seed,
        t_utc_ns=stage.t_start_utc_ns,
        ra_date_deg=float(ra_date_deg),
        dec_date_deg=float(dec_date_deg),
    )
    opens_ns = stage.t_start_utc_ns + round(latency_s * times.NS_PER_S)
    mid_ns = opens_ns + round(plan.exposure_s * times.NS_PER_S / 2)
    boresight = jnow_to_icrs(*mount.boresight_date_deg(mid_ns), mid_ns)
    _, truth = stage.scene.expose(*boresight, 1.7, False, opens_ns, plan.exposure_s)
    return json.loads(truth.to_json())
