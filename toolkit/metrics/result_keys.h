// The keys of a result document for writing and reading: each visit() names a struct's fields in document
// order. A visitor has `void operator()(const char* key, Field& field)` and later(), of the same form, for
// keys that earlier documents of the schema lack.
#pragma once

#include "toolkit/metrics/result_json.h"

// PALPATE_KEYS(a, b) shows members of a struct `s`, at most 64, to a visitor `v` under their own names:
// v("a", s.a); v("b", s.b); - each expansion calls for the next by way of PALPATE_AGAIN.
#define PALPATE_KEY(member) v(#member, s.member);
#define PALPATE_LATER_KEY(member) v.later(#member, s.member);
#define PALPATE_KEYS(...) PALPATE_AGAIN(PALPATE_EACH(PALPATE_KEY, __VA_ARGS__))
#define PALPATE_LATER_KEYS(...) PALPATE_AGAIN(PALPATE_EACH(PALPATE_LATER_KEY, __VA_ARGS__))
#define PALPATE_EACH(of, member, ...) of(member) __VA_OPT__(PALPATE_EACH_NEXT PALPATE_NONE(of, __VA_ARGS__))
#define PALPATE_EACH_NEXT() PALPATE_EACH
#define PALPATE_NONE ()
#define PALPATE_AGAIN(...) PALPATE_16(PALPATE_16(PALPATE_16(PALPATE_16(__VA_ARGS__))))
#define PALPATE_16(...) PALPATE_4(PALPATE_4(PALPATE_4(PALPATE_4(__VA_ARGS__))))
#define PALPATE_4(...) PALPATE_1(PALPATE_1(PALPATE_1(PALPATE_1(__VA_ARGS__))))
#define PALPATE_1(...) __VA_ARGS__

namespace palpate::metrics {

template <class V, class S>
void visit_statistics(V&& v, S& s) {
  PALPATE_KEYS(frames, contact_frames, timed_frames, min_us, mean_us)
  PALPATE_LATER_KEYS(mean_clocked_us)
  PALPATE_KEYS(p50_us, p99_us, p999_us, max_us, deadline_misses_1khz, bound_hits, clock_overhead_ns)
  PALPATE_LATER_KEYS(deadline_misses_5khz, deadline_misses_10khz, mean_interval_us, p50_interval_us,
                     p999_interval_us, cpu_mean_us, worst_us, passes, clocked_passes, episodes)
}

template <class V, class S>
void visit_paced(V&& v, S& s) {
  visit_statistics(v, s.frame);
  PALPATE_KEYS(period_ms, first_frame, evicted_bytes, skipped_ticks)
}

template <class V, class S>
void visit_accuracy(V&& v, S& s) {
  PALPATE_KEYS(reference, exactness, floor_n)
  PALPATE_LATER_KEYS(rounding_n, rounding_mm)
  PALPATE_KEYS(frames, contact_frames, force_rms_n, force_rms_percent, force_normal_rms_n,
               force_tangential_rms_n, force_max_n, within_7_percent, within_10_percent, direction_mean_deg,
               direction_p99_deg, direction_max_deg, excess_jump_max_n, excess_jumps, excess_jumps_per_m,
               missed_contact_frames, false_contact_frames, longest_stick_frames, pop_throughs,
               pop_through_rate_upper_95, god_object_rms_mm, god_object_max_mm, god_object_surface_rms_mm,
               god_object_surface_max_mm, onset_error_mm, onset_error_mean_mm, release_error_mm,
               release_error_mean_mm, path_dependence_n)
  PALPATE_LATER_KEYS(episodes, force_rms_percent_interval, force_p50_percent, force_p95_percent,
                     jump_error_max_n, jump_errors, lag_ms, felt_percent, missed_device_frames,
                     false_device_frames, fall_throughs, missed_tenth_mm_frames, false_tenth_mm_frames,
                     friction_cone_percent, friction_slip_error_percent, stick_slip_percent, stick_drift_mm_s,
                     history_frames, history_percent, history_force_rms_n, force_rms_whole_percent,
                     ripple_ratio, ripple_hz, relief_ratio, relief_width_mm, indistinguishable_percent,
                     indistinguishable_interval, caught, caught_frames, lost, lost_frames, kicks,
                     force_peak_n, force_peak_excess_percent)
}

template <class V, class S>
void visit_energy(V&& v, S& s) {
  PALPATE_KEYS(generated_percent, generated_mj, max_stored_mj, final_mj)
  PALPATE_LATER_KEYS(rounding_mj, drawdown_percent, drawdown_p50_percent)
}

template <class V, class S>
void visit_stream(V&& v, S& s) {
  PALPATE_KEYS(frames, taken, repeated, late, truncated)
  PALPATE_LATER_KEYS(failed)
  PALPATE_KEYS(skipped, swaps, stalled_frames, window_p50_ms, window_p99_ms, whole_p50_ms, whole_p99_ms,
               light_to_tick_p50_ms, light_to_tick_p99_ms, swaps_in_contact, releases, swap_step_max_n,
               swap_step_p99_n, rate_max_n_per_ms)
}

template <class V, class S>
void visit_prepare_clock(V&& v, S& s) {
  PALPATE_KEYS(wall_ms, cpu_ms, from_cache)
}

template <class V, class S>
void visit_timing(V&& v, S& s) {
  PALPATE_KEYS(contact_of, own_process, in_turns_with, pinned_cpu)
  PALPATE_LATER_KEYS(minor_faults, major_faults)
}

/// Plus `libraries`.
template <class V, class S>
void visit_conditions(V&& v, S& s) {
  PALPATE_KEYS(governor, huge_pages, processor_sets, compiled_for, compiler_flags, load_before, load_after,
               steal_percent, rounds, budget_s, order_seed)
}

/// Plus `sample`, which may be null.
template <class V, class S>
void visit_model(V&& v, S& s) {
  PALPATE_KEYS(name, source, hash, points)
}

template <class V, class S>
void visit_truth(V&& v, S& s) {
  PALPATE_KEYS(name, exactness, file)
  PALPATE_LATER_KEYS(hash)
}

/// Plus the two keys that are not single numbers.
template <class V, class S>
void visit_scoring(V&& v, S& s) {
  PALPATE_KEYS(stiffness_n_per_mm, device_resolution_mm, stored_rounding_mm)
  PALPATE_LATER_KEYS(static_friction, dynamic_friction)
}

template <class V, class S>
void visit_machine(V&& v, S& s) {
  PALPATE_KEYS(cpu, cores, memory_bytes, kernel, compiler)
}

}  // namespace palpate::metrics
