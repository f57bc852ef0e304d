"""What a GPU that a processor plays runs in CI, of the tests that all run on the CPU.

A part of the shaders has at least one test here that fails where the part is wrong, by what it
should be: a twin on the CPU is no witness of that. Of the cases of such a test those run that are
named, or else those that hold a value of a parameter not in one before. The twins are compared,
scene by scene, in `test_gpu`.
A real GPU runs every test, and so does any adapter in `make validate`.
"""

SENTINELS = {
    # Photons: trackers, interpolation, phase functions, tallies; the gathering of images.
    "test_furnace.py::test_white_furnace_is_uniform",
    "test_furnace.py::test_white_furnace_radiance_is_one_along_every_ray",
    "test_furnace.py::test_white_furnace_is_uniform_in_every_channel_of_a_chromatic_medium[woodcock-hg0.8]",
    "test_furnace.py::test_white_furnace_is_uniform_in_every_channel_of_a_chromatic_medium[march-rayleigh]",
    "test_trackers.py::test_collisions_in_layers_are_poisson_distributed",
    "test_trackers.py::test_light_is_followed_to_optical_depth_25",
    "test_slab.py::test_slab_reflects_and_transmits_as_adding_doubling",
    "test_slab.py::test_slab_reflects_the_same_along_every_axis",
    "test_infinite.py::test_moments_of_absorption_follow_the_legendre_moments",
    "test_cube60.py::test_cube60_absorbs_as_mcx",
    # The start of each light, and where its photons end.
    "test_energy.py::test_energy_of_each_light_adds_up",
    "test_energy.py::test_energy_of_each_channel_adds_up",
    "test_energy.py::test_photons_at_first_collisions_of_a_lamp_hold_its_power",
    "test_energy.py::test_capped_forward_scattering_truncates_the_poisson_tail",
    "test_environment.py::test_fluence_in_a_void_is_the_integral_of_the_map",
    "test_environment.py::test_light_of_an_axis_falls_on_its_face",
    "test_environment.py::test_a_camera_sees_the_map_where_it_looks",
    "test_environment.py::test_the_background_is_the_map_through_the_medium",
    # Emission: its start, its ways to the eye, its balance with absorption.
    "test_emission.py::test_the_image_is_the_line_integral",
    "test_emission.py::test_equilibrium_is_uniform",
    "test_emission.py::test_empty_blocks_are_not_passed_over",
    # Small and unequal powers in integers; absorption within voxels.
    "test_tally.py::test_small_albedos_keep_their_mean",
    "test_tally.py::test_deposits_far_below_a_unit_keep_their_mean",
    "test_tally.py::test_a_weak_channel_of_unequal_extinctions_keeps_its_error",
    "test_absorbed.py::test_absorbed_power_adds_up_to_the_energy",
    # Order 1 along view rays; the outline; harmonics.
    "test_single.py::test_single_scattering_matches_quadrature",
    "test_single.py::test_single_scattering_matches_quadrature_with_the_light_inside",
    "test_single.py::test_albedo_of_each_voxel_scales_its_scattering",
    "test_single.py::test_alpha_is_one_minus_transmittance",
    "test_order1.py::test_order_1_of_a_half_space_is_its_closed_form",
    "test_order1.py::test_order_1_of_a_smooth_slab_from_the_light_grid_is_its_closed_form[0.6-1.0-linear]",
    "test_outline.py::test_edges_along_rows_and_columns_are_covered_exactly",
    "test_outline.py::test_boxes_smaller_than_a_pixel_are_seen",
    "test_outline.py::test_the_sky_is_seen_past_the_outline",
    "test_angular.py::test_harmonics_of_rayleigh_are_what_the_eye_records[environment]",
    "test_angular.py::test_one_run_gives_the_images_of_runs_for_each_eye[rgb]",
    "test_angular.py::test_one_run_gives_the_images_of_runs_for_each_eye[environment]",
    # Paths: the same, and lights near by, solids, and to go on where a run ended.
    "test_path.py::test_slab_has_the_radiance_of_van_de_hulst[woodcock linear]",
    "test_path.py::test_slab_has_the_radiance_of_van_de_hulst[march]",
    "test_path.py::test_order_1_of_a_homogeneous_medium_is_its_quadrature",
    "test_path.py::test_order_1_of_voxels_is_their_quadrature",
    "test_path.py::test_each_channel_is_its_own_grey_run",
    "test_path.py::test_error_bars_have_the_right_size",
    "test_path_sky.py::test_white_furnace_is_white",
    "test_path_sky.py::test_a_medium_as_hot_as_its_surroundings_is_not_seen",
    "test_path_sky.py::test_one_bright_texel_is_a_directional_light",
    "test_path_lights.py::test_order_1_of_a_light_inside_is_its_quadrature",
    "test_path_lights.py::test_order_1_of_a_light_among_voxels_is_its_quadrature",
    "test_path_solids.py::test_alpha_of_a_sphere_is_one_less_the_transmittance_of_its_chords",
    "test_path_solids.py::test_alpha_of_a_box_is_one_less_the_transmittance_of_its_chords",
    "test_path_solids.py::test_order_1_of_a_sphere_is_its_quadrature",
    "test_path_api.py::test_more_samples_go_on_where_fewer_ended",
    "test_path_api.py::test_target_error_is_reached_and_honest",
}
