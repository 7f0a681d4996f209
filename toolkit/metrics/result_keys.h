// The keys of a result document for writing and reading: each visit() names a struct's fields in document
// order. A visitor has `void operator()(const char* key, Field& field)` and later(), of the same form, for
// keys that earlier documents of the schema lack.
#pragma once

#include "toolkit/metrics/result_json.h"

namespace palpate::metrics {

template <class V, class S>
void visit_statistics(V&& v, S& s) {
  v("frames", s.frames);
  v("contact_frames", s.contact_frames);
  v("timed_frames", s.timed_frames);
  v("min_us", s.min_us);
  v("mean_us", s.mean_us);
  v.later("mean_clocked_us", s.mean_clocked_us);
  v("p50_us", s.p50_us);
  v("p99_us", s.p99_us);
  v("p999_us", s.p999_us);
  v("max_us", s.max_us);
  v("deadline_misses_1khz", s.deadline_misses_1khz);
  v("bound_hits", s.bound_hits);
  v("clock_overhead_ns", s.clock_overhead_ns);
  v.later("deadline_misses_5khz", s.deadline_misses_5khz);
  v.later("deadline_misses_10khz", s.deadline_misses_10khz);
  v.later("mean_interval_us", s.mean_interval_us);
  v.later("p50_interval_us", s.p50_interval_us);
  v.later("p999_interval_us", s.p999_interval_us);
  v.later("cpu_mean_us", s.cpu_mean_us);
  v.later("worst_us", s.worst_us);
  v.later("passes", s.passes);
  v.later("clocked_passes", s.clocked_passes);
  v.later("episodes", s.episodes);
}

template <class V, class S>
void visit_paced(V&& v, S& s) {
  visit_statistics(v, s.frame);
  v("period_ms", s.period_ms);
  v("first_frame", s.first_frame);
  v("evicted_bytes", s.evicted_bytes);
  v("skipped_ticks", s.skipped_ticks);
}

template <class V, class S>
void visit_accuracy(V&& v, S& s) {
  v("reference", s.reference);
  v("exactness", s.exactness);
  v("floor_n", s.floor_n);
  v.later("rounding_n", s.rounding_n);
  v.later("rounding_mm", s.rounding_mm);
  v("frames", s.frames);
  v("contact_frames", s.contact_frames);
  v("force_rms_n", s.force_rms_n);
  v("force_rms_percent", s.force_rms_percent);
  v("force_normal_rms_n", s.force_normal_rms_n);
  v("force_tangential_rms_n", s.force_tangential_rms_n);
  v("force_max_n", s.force_max_n);
  v("within_7_percent", s.within_7_percent);
  v("within_10_percent", s.within_10_percent);
  v("direction_mean_deg", s.direction_mean_deg);
  v("direction_p99_deg", s.direction_p99_deg);
  v("direction_max_deg", s.direction_max_deg);
  v("excess_jump_max_n", s.excess_jump_max_n);
  v("excess_jumps", s.excess_jumps);
  v("excess_jumps_per_m", s.excess_jumps_per_m);
  v("missed_contact_frames", s.missed_contact_frames);
  v("false_contact_frames", s.false_contact_frames);
  v("longest_stick_frames", s.longest_stick_frames);
  v("pop_throughs", s.pop_throughs);
  v("pop_through_rate_upper_95", s.pop_through_rate_upper_95);
  v("god_object_rms_mm", s.god_object_rms_mm);
  v("god_object_max_mm", s.god_object_max_mm);
  v("god_object_surface_rms_mm", s.god_object_surface_rms_mm);
  v("god_object_surface_max_mm", s.god_object_surface_max_mm);
  v("onset_error_mm", s.onset_error_mm);
  v("onset_error_mean_mm", s.onset_error_mean_mm);
  v("release_error_mm", s.release_error_mm);
  v("release_error_mean_mm", s.release_error_mean_mm);
  v("path_dependence_n", s.path_dependence_n);
  v.later("episodes", s.episodes);
  v.later("force_rms_percent_interval", s.force_rms_percent_interval);
  v.later("force_p50_percent", s.force_p50_percent);
  v.later("force_p95_percent", s.force_p95_percent);
  v.later("jump_error_max_n", s.jump_error_max_n);
  v.later("jump_errors", s.jump_errors);
  v.later("lag_ms", s.lag_ms);
  v.later("felt_percent", s.felt_percent);
  v.later("missed_device_frames", s.missed_device_frames);
  v.later("false_device_frames", s.false_device_frames);
  v.later("fall_throughs", s.fall_throughs);
  v.later("missed_tenth_mm_frames", s.missed_tenth_mm_frames);
  v.later("false_tenth_mm_frames", s.false_tenth_mm_frames);
  v.later("friction_cone_percent", s.friction_cone_percent);
  v.later("friction_slip_error_percent", s.friction_slip_error_percent);
  v.later("stick_slip_percent", s.stick_slip_percent);
  v.later("stick_drift_mm_s", s.stick_drift_mm_s);
  v.later("history_frames", s.history_frames);
  v.later("history_percent", s.history_percent);
  v.later("history_force_rms_n", s.history_force_rms_n);
  v.later("force_rms_whole_percent", s.force_rms_whole_percent);
  v.later("ripple_ratio", s.ripple_ratio);
  v.later("ripple_hz", s.ripple_hz);
  v.later("relief_ratio", s.relief_ratio);
  v.later("relief_width_mm", s.relief_width_mm);
  v.later("indistinguishable_percent", s.indistinguishable_percent);
  v.later("indistinguishable_interval", s.indistinguishable_interval);
  v.later("caught", s.caught);
  v.later("caught_frames", s.caught_frames);
  v.later("lost", s.lost);
  v.later("lost_frames", s.lost_frames);
  v.later("kicks", s.kicks);
  v.later("force_peak_n", s.force_peak_n);
  v.later("force_peak_excess_percent", s.force_peak_excess_percent);
}

template <class V, class S>
void visit_energy(V&& v, S& s) {
  v("generated_percent", s.generated_percent);
  v("generated_mj", s.generated_mj);
  v("max_stored_mj", s.max_stored_mj);
  v("final_mj", s.final_mj);
  v.later("rounding_mj", s.rounding_mj);
  v.later("drawdown_percent", s.drawdown_percent);
  v.later("drawdown_p50_percent", s.drawdown_p50_percent);
}

template <class V, class S>
void visit_stream(V&& v, S& s) {
  v("frames", s.frames);
  v("taken", s.taken);
  v("repeated", s.repeated);
  v("late", s.late);
  v("truncated", s.truncated);
  v.later("failed", s.failed);
  v("skipped", s.skipped);
  v("swaps", s.swaps);
  v("stalled_frames", s.stalled_frames);
  v("window_p50_ms", s.window_p50_ms);
  v("window_p99_ms", s.window_p99_ms);
  v("whole_p50_ms", s.whole_p50_ms);
  v("whole_p99_ms", s.whole_p99_ms);
  v("light_to_tick_p50_ms", s.light_to_tick_p50_ms);
  v("light_to_tick_p99_ms", s.light_to_tick_p99_ms);
  v("swaps_in_contact", s.swaps_in_contact);
  v("releases", s.releases);
  v("swap_step_max_n", s.swap_step_max_n);
  v("swap_step_p99_n", s.swap_step_p99_n);
  v("rate_max_n_per_ms", s.rate_max_n_per_ms);
}

template <class V, class S>
void visit_prepare_clock(V&& v, S& s) {
  v("wall_ms", s.wall_ms);
  v("cpu_ms", s.cpu_ms);
  v("from_cache", s.from_cache);
}

template <class V, class S>
void visit_timing(V&& v, S& s) {
  v("contact_of", s.contact_of);
  v("own_process", s.own_process);
  v("in_turns_with", s.in_turns_with);
  v("pinned_cpu", s.pinned_cpu);
  v.later("minor_faults", s.minor_faults);
  v.later("major_faults", s.major_faults);
}

/// Plus `libraries`.
template <class V, class S>
void visit_conditions(V&& v, S& s) {
  v("governor", s.governor);
  v("huge_pages", s.huge_pages);
  v("processor_sets", s.processor_sets);
  v("compiled_for", s.compiled_for);
  v("compiler_flags", s.compiler_flags);
  v("load_before", s.load_before);
  v("load_after", s.load_after);
  v("steal_percent", s.steal_percent);
  v("rounds", s.rounds);
  v("budget_s", s.budget_s);
  v("order_seed", s.order_seed);
}

/// Plus `sample`, which may be null.
template <class V, class S>
void visit_model(V&& v, S& s) {
  v("name", s.name);
  v("source", s.source);
  v("hash", s.hash);
  v("points", s.points);
}

template <class V, class S>
void visit_truth(V&& v, S& s) {
  v("name", s.name);
  v("exactness", s.exactness);
  v("file", s.file);
  v.later("hash", s.hash);
}

/// Plus the two keys that are not single numbers.
template <class V, class S>
void visit_scoring(V&& v, S& s) {
  v("stiffness_n_per_mm", s.stiffness_n_per_mm);
  v("device_resolution_mm", s.device_resolution_mm);
  v("stored_rounding_mm", s.stored_rounding_mm);
  v.later("static_friction", s.static_friction);
  v.later("dynamic_friction", s.dynamic_friction);
}

template <class V, class S>
void visit_machine(V&& v, S& s) {
  v("cpu", s.cpu);
  v("cores", s.cores);
  v("memory_bytes", s.memory_bytes);
  v("kernel", s.kernel);
  v("compiler", s.compiler);
}

}  // namespace palpate::metrics
