"""Every public column in one line: name, type, meaning."""

OF_FRAME = """
name text as the camera named it
t_start_utc_ns integer beginning of the exposure, by the header
exposure_s real length of the exposure
width_px integer columns
height_px integer rows
pointing_ra_icrs_deg real where the mount said it pointed
pointing_dec_icrs_deg real where the mount said it pointed
binning=camera.binning text as 2x2, where the header tells it
x0_px=camera.x0_px integer where a subframe begins on the sensor, column
y0_px=camera.y0_px integer where a subframe begins on the sensor, row
gain=camera.gain real in the camera's own steps
time_by=camera.time_by text header or gps: whose time the exposure has; null: not said
"""

OF_FILES = """
file text its pixels, in the session's folder
file_bytes integer how long that file is
not_kept_because text why the pixels were not kept
preview text its small picture
file_sha256 text hash of the file of its pixels
"""

OF_CANDIDATE = """
confidence real probability that it is a real streak
x_px real midpoint, column
y_px real midpoint, row
x_a_px real one end
y_a_px real one end
x_b_px real the other end
y_b_px real the other end
length_px real length of the streak
width_px real full width at half maximum across it; 0: not measured
snr real matched-filter signal to noise of the whole; 0: not measured
sigma_along_px real one sigma of the midpoint along it
sigma_across_px real one sigma of the midpoint across it
is_clipped truth an end lies outside the frame
method text line, box or operator
x0_px=box_px.0 real the network's box
y0_px=box_px.1 real the network's box
x1_px=box_px.2 real the network's box
y1_px=box_px.3 real the network's box
unevenness real how much light and path vary more than noise explains
kind text streak, clipped or crossing: both its ends in the frame, one, none
sigma_angle_deg real one sigma of its direction
object_class text satellite, aircraft, meteor, cosmic ray, star chain or undetermined
class_probability real of that class, given that it is a real streak
modulation_period_px real along it, of light that comes and goes regularly
modulation_period_s real the same in time
modulation_depth real most less least over their sum, of that light
train integer lines that run parallel as a train, itself among them; 0: none
light_offset_px real towards end b from the midpoint: the middle of a steady light by ends and light
light_sigma_px real one sigma of that
light_length_px real length of the even motion, likewise
light_length_sigma_px real one sigma of that
"""

OF_SOLUTION = """
ra_icrs_deg real at the image's centre
dec_icrs_deg real at the image's centre
scale_arcsec_px real size of a pixel on the sky
rotation_deg real position angle of the array's y axis, east of north
is_flipped truth a mirror image of the sky
matched integer stars that agree with the catalogue
rms_arcsec real residual of one star, per axis
path text full, refit or shift
ms real how long it took
wcs json gnomonic plate with its distortion
"""

OF_MEASUREMENT = """
t_mid_utc_ns integer mid-exposure by the shutter
ra_icrs_deg real astrometric right ascension
dec_icrs_deg real astrometric declination
x_px real the streak's midpoint, column
y_px real the streak's midpoint, row
confidence real of the detection, 0 to 1
source text network, faint (below tau, taken with other frames) or operator
is_clipped truth the frame cuts the streak
is_crossing truth neither end is in the frame
object_class text what its own frame makes of it
cov_ee_arcsec2=cov_sky_arcsec2.0 real covariance, east-east
cov_en_arcsec2=cov_sky_arcsec2.1 real covariance, east-north
cov_nn_arcsec2=cov_sky_arcsec2.2 real covariance, north-north
ends_icrs_deg real[2,2] right ascension and declination of both ends
measurement_id text its id, unique in the session
"""

OF_NOT_FOLLOWED = """
ra_icrs_deg=measurement.ra_icrs_deg real measured right ascension
dec_icrs_deg=measurement.dec_icrs_deg real measured declination
reason text why it was not taken
measurement_id=measurement.measurement_id text which measurement
track_id integer the track that did not take it
"""

OF_TRACK = """
step=kind text initial, predicted or updated
t_state_utc_ns=t_utc_ns integer instant of the state
ra_icrs_deg=x.0 real right ascension
ra_rate_deg_s=x.1 real its rate
dec_icrs_deg=x.2 real declination
dec_rate_deg_s=x.3 real its rate
covariance=P real[4,4] of the four, deg and deg/s
nis real normalised innovation squared of the update
innovation_east_arcsec=innovation_arcsec.0 real measured minus predicted, times cos Dec
innovation_north_arcsec=innovation_arcsec.1 real measured minus predicted
sigma_east_arcsec=sigma_innovation_arcsec.0 real one sigma of that
sigma_north_arcsec=sigma_innovation_arcsec.1 real one sigma of that
misses integer exposures since the last measurement
foretold_by text filter or orbit: whose prediction it is
track_id integer the track, from 1 in the order in which they began
measurement_id text the measurement that it took
first_measurement_id=begun_with.0 text the earlier of the two that it began with
begun_through json the measurements between the two, where a chain of them began it
is_lead truth the telescope follows this one
is_kept truth the operator keeps it, whatever it misses in the field
replaces integer the track that ended where this one took it up again; empty: it took up none
turn=mixture.turn real of its path to the left, radians for each radian that it goes on
scatter_s=mixture.scatter_s real excess scatter along the motion, as of the shutter's time
scatter_low_s=mixture.scatter_low_s real lower end of its interval of 90 %
scatter_high_s=mixture.scatter_high_s real upper end of it
variance_scale=mixture.variance_scale real of the variances that measurements claim
along_arcsec=mixture.along_arcsec real sigma along the motion that the length of the streak adds
shared_with integer the track that took the same streak, which the frame could not show apart
filter_nis real NIS by the filter's own prediction, refused by its gate; the orbit's was taken
"""

OF_SLEW = """
ra_icrs_deg real where to look
dec_icrs_deg real where to look
t_aim_utc_ns integer the instant that is computed for
reason text why there
track_id integer the track that it leads to
"""

OF_MISS = """
reason text why nothing was measured
track_id integer the track that misses it
"""

OF_ORBIT = """
label text free, constrained by prior, weak geometry or not observable
prior text what was assumed beforehand; none for a free orbit
reason text why it has that label
observations integer measurements in it
arc_s real from the first to the last of them
epoch_utc_ns integer instant of the state
x_gcrs_km=r_gcrs_km.0 real position
y_gcrs_km=r_gcrs_km.1 real position
z_gcrs_km=r_gcrs_km.2 real position
vx_gcrs_km_s=v_gcrs_km_s.0 real velocity
vy_gcrs_km_s=v_gcrs_km_s.1 real velocity
vz_gcrs_km_s=v_gcrs_km_s.2 real velocity
covariance real[6,6] of both, km and km/s
a_km real semi-major axis, osculating
e real eccentricity
i_deg real inclination to the GCRS equator
sigma_a_km real one sigma of the semi-major axis
rms_arcsec real residual of its measurements
outliers integer measurements that were left out
nis real normalised innovation squared against the orbit before it
innovation_east_arcsec=innovation_arcsec.0 real measured minus predicted, times cos Dec
innovation_north_arcsec=innovation_arcsec.1 real measured minus predicted
is_guide truth the telescope goes where it says
track_id integer the track that it is of
"""

OF_NAME = """
verdict text identified, ambiguous or unknown
reason text why
hint text of a manoeuvre
observations integer measurements that were compared
catalogued integer objects that they were compared with
norad_id=matches.0.norad_id integer catalogue number of the best match
name=matches.0.name text its name
separation_arcsec=matches.0.separation_arcsec real how far off it is
probability=matches.0.probability real that it is this one
runner_up_norad_id=matches.1.norad_id integer catalogue number of the second
runner_up_name=matches.1.name text its name
runner_up_separation_arcsec=matches.1.separation_arcsec real how far off it is
matches json the best of them, best first
track_id integer the track that it is of
not_catalogued real probability that no catalogue knows it
named_with integer other tracks that it was named together with
ledger_number=ledger.number integer the object of an earlier night that it is or may be
ledger_name=ledger.name text its name
ledger_probability=ledger.probability real that it is that one
"""

OF_PAIR = """
t_pair_utc_ns=t_utc_ns integer instant of the separation
track_id integer the one track
other_track_id integer the other
frames integer that have shown both
separation_arcsec real between them
sigma_separation_arcsec real one sigma of that
position_angle_deg real of the other from the one, from north through east
sigma_position_angle_deg real one sigma of that
east_arcsec real the way from the one to the other
north_arcsec real the way from the one to the other
sigma_east_arcsec real one sigma of that
sigma_north_arcsec real one sigma of that
rate_east_arcsec_min real how it changes
rate_north_arcsec_min real how it changes
sigma_rate_east_arcsec_min real one sigma of that
sigma_rate_north_arcsec_min real one sigma of that
separation_rate_arcsec_min real how the separation changes, below 0 while they approach
sigma_separation_rate_arcsec_min real one sigma of that
closest text now, ahead or beyond: at the beginning of the horizon, inside it, at its end
closest_utc_ns integer when they are nearest within the horizon
sigma_closest_s real one sigma of that
closest_arcsec real how near, the median
closest_low_arcsec real lower end of the interval of 68 %
closest_high_arcsec real upper end of it
closest_lowest_arcsec real lower end of the interval of 95 %
closest_highest_arcsec real upper end of it
horizon_s real how far ahead was looked
path text straight or curved: what the approach was found from
close_probability real that they come nearer than the angle of the warning
is_close truth the operator is warned of them
"""

OF_EXPECTED = """
norad_id integer catalogue number
name text its name
ra_icrs_deg real at mid-exposure, by its elements
dec_icrs_deg real at mid-exposure, by its elements
x_px real column
y_px real row
sigma_arcsec real how far off its elements may be, along its motion
tle_age_days real of its elements
is_usable truth its whole streak is in the frame
is_lit truth by the Sun
"""

OF_QUALITY = """
star_count integer stars found, up to a few hundred
star_fwhm_px real median full width of the stars at half their height
star_flux_adu real of a middling one of the brightest stars
background_adu real median of the sky in a pixel, and the camera's offset without a dark
"""

OF_LEAP = """
begun_frame_id integer frame of the first streak of what is followed
number integer 1 for the first after that streak
result text met, not in the frame, another streak, not solved
t_order_utc_ns integer when its slew was ordered
ordered text what that order waited for: at close (of the shutter before), by a look, by the frame
t_mid_utc_ns integer when it was to be met
ra_icrs_deg real where
dec_icrs_deg real where
speed_arcsec_s real how fast it was to be
sigma_along_arcsec real one sigma of that place
sigma_across_arcsec real one sigma of that place
within real probability of both ends in the field
flips truth whether the mount changed the side of its pier for it
exposure_s real as planned
binning integer pixels joined on each axis
off_along_arcsec real measured minus predicted, before the update
off_across_arcsec real to the left of the motion
total_s real from the order of its slew until the next could be ordered
slew_s real of this
settle_s real of this
shutter_s real until it opened, beyond what the mount settled in
open_s real of this
readout_s real of this, with what came of the frame
wait_s real of this, for the satellite to come
subframe real share of each side of the sensor that was read out
"""

OF_LOW_PASS = """
begun_frame_id integer frame of its first streak
name text of what was waited for; empty: whatever came
ended text why it was not followed further
streaks integer how many
planned_leaps integer as many as the mount would have allowed
t_first_utc_ns integer middle of the first streak
t_last_utc_ns integer middle of the last streak
probability real of the sense of its motion
epoch_utc_ns integer of the orbit
r_gcrs_km real[3] at the epoch
v_gcrs_km_s real[3] at the epoch
covariance real[6,6] of both
a_km real semi-major axis
e real eccentricity
i_deg real inclination
believes_round truth whether a prior on its eccentricity is in it
along_rms_arcsec real ends of its streaks against the orbit
across_rms_arcsec real ends of its streaks against the orbit
t_next_rise_utc_ns integer when it comes again
sigma_next_s real of that
sigma_next_across_deg real of where it then is
scatter_s real of the shutter, as calibrated or as the streaks told
"""

OF_PHOTOMETRY = """
zero_point_mag real magnitude of a star of the Sun's colour that would give 1 ADU a second
zero_point_sigma_mag real one sigma of that
zero_point_stars integer catalogue stars it comes from
zero_point_scatter_mag real scatter of those stars about it
colour_term real change of the zero point per magnitude of BT - VT
colour_term_sigma real one sigma of that
limiting_mag real magnitude of a star with a signal to noise of 5
"""

OF_MAGNITUDE = """
measurement_id text the measurement with the same light
flux_adu real light of the whole streak above sky and stars, ADU
flux_sigma_adu real one sigma of that
rate_adu_s real light by the time in the frame, ADU a second
rate_sigma_adu_s real one sigma of that
band text V, or instrumental: 0 mag is 1 ADU a second
mag real apparent magnitude
mag_sigma real one sigma of that by noise and zero point
mag_sigma_colour real one sigma by the object's unknown colour
is_saturated truth pixels of the streak are saturated: it is brighter
is_blended truth stars on it had more than a tenth of its light
steps json light in short steps from end a: t_s, rate_adu_s, rate_sigma_adu_s
"""
