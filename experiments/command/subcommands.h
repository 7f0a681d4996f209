// Every verb and its kinds, a line each: in the order of --help.
#pragma once

#include "experiments/command/subcommand.h"

#define PALPATE_SUBCOMMANDS(DO) \
  DO(info)                      \
  DO(plan)                      \
  DO(renderers)                 \
  DO(paths)                     \
  DO(scans)                     \
  DO(steps)                     \
  DO(devices)                   \
  DO(clean)                     \
  DO(fetch)                     \
  DO(prepare)                   \
  DO(compare)                   \
  DO(sweep)                     \
  DO(merge)                     \
  DO(ablate)                    \
  DO(tune)                      \
  DO(behaviours)                \
  DO(stress)                    \
  DO(hunt)                      \
  DO(stability)                 \
  DO(goals)                     \
  DO(bench)                     \
  DO(live)                      \
  DO(record)                    \
  DO(serve)                     \
  DO(study)                     \
  DO(report)                    \
  DO(score)                     \
  DO(export)                    \
  DO(reproduce)

namespace palpate::experiments {

/// The first word of a command. `group`: its heading in --help.
struct Verb {
  const char *group, *name, *summary;
};
inline constexpr Verb kVerbs[] = {
    {"Look", "info", "what a model or a recording holds; info plan: what would be built for a scene"},
    {"", "list", "renderers, paths, scans, cleaning steps, devices"},
    {"Prepare", "clean", "cleans a raw scan: outliers, smoothing, thinning, holes"},
    {"", "fetch", "downloads a known scan into the cache, and checks it"},
    {"", "prepare", "writes a scan's smooth surface to a file that is felt at once, from disk"},
    {"Measure", "compare", "renderers along one path, and a report; also sweep, merge, ablate"},
    {"", "tune", "finds the cheapest setting that is accurate enough"},
    {"", "test", "suites: behaviours, stress, hunt, stability, goals, bench"},
    {"Touch", "live", "renderers under a hand on a device, switched while felt; also record, serve"},
    {"", "study", "blinded comparisons and staircases, with people or without"},
    {"Keep", "report", "draws a study's report again; also score, export"},
    {"", "reproduce", "measures the thesis's tables again, beside the printed values"}};

#define PALPATE_DECLARE(name) Subcommand name##_subcommand();
PALPATE_SUBCOMMANDS(PALPATE_DECLARE)
#undef PALPATE_DECLARE

inline std::vector<Subcommand> all_subcommands() {
#define PALPATE_LIST(name) name##_subcommand(),
  return {PALPATE_SUBCOMMANDS(PALPATE_LIST)};
#undef PALPATE_LIST
}

}  // namespace palpate::experiments
