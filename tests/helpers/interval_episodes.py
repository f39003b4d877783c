"""What each episode's interval is made of, beside the truth: a row an episode, for fitting factors.

Everything but `log_ratio` and `off_m` is known to the robot.
"""

import numpy as np

from fit.revolution.geometry import revolution_surface
from fit.rotation import matrix_of_quaternion
from fit.superquadric.geometry import Superquadric, superquadric_areas, superquadric_volume
from fit.superquadric.uncertainty import surface_distance, surface_std
from strategies.contacts import body_uncertainty as bu
from strategies.contacts.felt import FOOT_M, Felt, unfelt_distance
from strategies.recovery.choose_model import Shape
from strategies.recovery.contact_verdict import accepted_rms, contact_verdicts
from strategies.recovery.misfit import touch_misfit
from sweeps.episode.episodes import EpisodeBlock, run_block
from sweeps.spec.cell import Cell
from warpgrasp.geometry.body_sampling import sample_body

PLACES = 128


def episode_rows(cell: Cell, episodes: int) -> dict[str, np.ndarray]:
    """Columns of the episodes that recovered a body."""
    block = run_block(cell, np.arange(episodes), "cpu")
    return rows_of_block(block)


def rows_of_block(block: EpisodeBlock) -> dict[str, np.ndarray]:
    belief, recovered = block.exploration.belief, block.recovered
    known = (block.status == "ok") & (recovered.shape != Shape.PRIOR_CYLINDER)
    un, felt, ev = belief.uncertainty, belief.felt, belief.evidence
    true = sample_body(block.body, surface=PLACES)
    worlds = belief.worlds
    turned = recovered.shape == Shape.REVOLUTION
    unfelt = un.log_volume_shift / bu.OUTSIDE
    share = felt.contradicted_share()
    own = np.sqrt(np.maximum(un.log_volume_std**2 - (bu.SPREAD * unfelt) ** 2
                             - (bu.CONTRADICTED_SPREAD * share) ** 2, 0.0))
    sq_points, sq_area = superquadric_areas(Superquadric(*belief.body), 600)
    top, wide, near10, near20, nearmean = (np.full(worlds, np.nan) for _ in range(5))
    upper = np.full(worlds, np.nan)
    far_contact = np.full(worlds, np.nan)
    rev = None
    if recovered.revolution is not None:
        rev = revolution_surface(recovered.revolution)
    prior = belief.prior
    for w in np.flatnonzero(known):
        p, a = (rev[0][w], rev[2][w]) if turned[w] and rev is not None else (sq_points[w], sq_area[w])
        ok = p[:, 2] > FOOT_M
        use = felt.mask[w] & ~felt.contradicted[w]
        d = unfelt_distance(p[None], Felt(*(getattr(felt, f)[w:w + 1] for f in
                       ("points_m", "mask", "covariance_m2", "contradicted"))))[0]
        top[w] = p[:, 2].max()
        wide[w] = np.quantile(np.hypot(p[:, 0] - np.average(p[:, 0], weights=a),
                                       p[:, 1] - np.average(p[:, 1], weights=a)), 0.95)
        near10[w], near20[w] = (a[ok & (d < r)].sum() / a[ok].sum() for r in (0.01, 0.02))
        nearmean[w] = (a * d)[ok].sum() / a[ok].sum()
        if use.any():
            z = felt.points_m[w][use][:, 2]
            upper[w] = np.quantile(z, 0.95)
            mid = p.mean(0)
            az = np.arctan2(felt.points_m[w][use][:, 1] - mid[1], felt.points_m[w][use][:, 0] - mid[0])
            far_contact[w] = np.abs(np.exp(1j * az).mean())
    verdicts = contact_verdicts(recovered, ev)
    n = np.maximum(ev.mask.sum(1), 1)
    sig = np.sqrt(np.maximum(np.linalg.eigvalsh(np.where(ev.mask[..., None, None],
                                                         ev.covariance_m2, 0.0))[..., -1], 0))
    columns = {
        "known": known, "turned": turned,
        "log_ratio": np.log(true.volume_m3 / un.volume_m3),
        "own": own, "unfelt": unfelt, "contradicted": share,
        "unsure": (np.isinf(ev.contradiction) & ev.mask).sum(1) / n,
        "nan": (np.isnan(ev.contradiction) & ev.mask).sum(1),
        "contacts": ev.mask.sum(1), "pads": (ev.by_pad & ev.mask).sum(1),
        "rms_m": accepted_rms(recovered, ev), "misfit_m": touch_misfit(belief.fits, ev),
        "top_m": top, "wide_m": wide, "prior_height_m": prior.height_m,
        "prior_radius_m": prior.radius_m, "volume_m3": un.volume_m3,
        "near10": near10, "near20": near20, "nearmean_m": nearmean, "upper_m": upper,
        "azimuth": far_contact, "touches": belief.touches,
        "sq_volume_m3": superquadric_volume(Superquadric(*belief.body)), "fitted": belief.fitted,
        "rev_volume_m3": (np.full(worlds, np.nan) if belief.profile is None
                          else belief.profile.volume_m3),
        "eps1": belief.body.exponents[:, 0], "eps2": belief.body.exponents[:, 1],
        "taper": np.abs(belief.body.taper).max(1), "kx": belief.body.taper[:, 0],
        "a1": belief.body.size_m[:, 0], "a2": belief.body.size_m[:, 1],
        "a3": belief.body.size_m[:, 2],
        "along_m": np.array([np.median(s[m]) if m.any() else np.nan
                             for s, m in zip(sig, ev.mask & ~ev.by_pad, strict=True)]),
        **{f"v_{k}": (verdicts == k).sum(1) / n for k in
           ("accepted", "unsure_link", "unsure_place", "contradicted", "far")},
        "faces": sum((f.fit.n_points > 0).astype(int) for f in belief.faces)
        if belief.faces else np.zeros(worlds, int),
    }
    body = Superquadric(*recovered.superquadric)
    pose = block.truth.body_pose
    surface = true.surface_m @ matrix_of_quaternion(pose[:, 3:]).swapaxes(1, 2) + pose[:, None, :3]
    columns["off_m"] = surface_distance(body, surface)[0].astype(np.float32)
    columns["place_std_m"] = surface_std(body, un, surface).astype(np.float32)
    columns["place_unfelt_m"] = unfelt_distance(surface, felt).astype(np.float32)
    return {name: np.asarray(values)[known] for name, values in columns.items()} | {
        "episode": np.flatnonzero(known)}
