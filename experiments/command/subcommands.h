// Every subcommand, a line each: in the order of --help.
#pragma once

#include "experiments/command/subcommand.h"

#define PALPATE_SUBCOMMANDS(DO) \
  DO(info)                      \
  DO(plan)                      \
  DO(clean)                     \
  DO(renderers)                 \
  DO(paths)                     \
  DO(replay)                    \
  DO(compare)                   \
  DO(sweep)                     \
  DO(merge)                     \
  DO(tune)                      \
  DO(stability)                 \
  DO(live)                      \
  DO(study)                     \
  DO(ablate)                    \
  DO(goals)                     \
  DO(record)                    \
  DO(export)                    \
  DO(report)                    \
  DO(score)                     \
  DO(reproduce)                 \
  DO(behaviours)                \
  DO(hunt)                      \
  DO(stress)                    \
  DO(devices)                   \
  DO(bridge)                    \
  DO(fetch)

namespace palpate::experiments {

#define PALPATE_DECLARE(name) Subcommand name##_subcommand();
PALPATE_SUBCOMMANDS(PALPATE_DECLARE)
#undef PALPATE_DECLARE

inline std::vector<Subcommand> all_subcommands() {
#define PALPATE_LIST(name) name##_subcommand(),
  return {PALPATE_SUBCOMMANDS(PALPATE_LIST)};
#undef PALPATE_LIST
}

}  // namespace palpate::experiments
