"""Drawings of a study and of single episodes, as SVG, PDF or PNG."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "contacts": ["contacts_figure", "contacts_shown", "draw_contacts"],
    "contour": ["contour_figure"],
    "curves": ["draw_curves", "draw_levels"],
    "faces": ["crossed_faces", "draw_faces", "faces_figure", "faces_shown"],
    "fits": ["draw_fits"],
    "forest": ["draw_forest"],
    "grasp": ["grasp_figure", "hand_solids"],
    "heat_maps": ["draw_confusion", "draw_settings"],
    "meshes": ["coarse_mesh", "mesh_of_world", "quadrilaterals", "recovered_faces",
               "recovered_grid", "surface_mesh", "true_mesh", "turned_mesh"],
    "pareto": ["draw_pareto"],
    "replay_frames": ["Replay", "make_replay", "replay_of", "segment_pose"],
    "solids": ["CONTACT", "FIT", "TRUE", "direction", "draw_solid", "lit", "set_box", "set_cube",
               "visible"],
    "style": ["COLOURS", "COLUMN_IN", "MUTED", "UNITS", "VERDICTS", "cut", "distinct_labels",
              "drawing", "encode", "figure", "order_of"],
    "taxels": ["draw_taxels", "pad_touches", "taxels_figure", "taxels_shown"],
})
