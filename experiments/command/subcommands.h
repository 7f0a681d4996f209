// Every subcommand, a line each: in the order of --help.
#pragma once

#include "experiments/command/subcommand.h"

namespace palpate::experiments {

Subcommand info_subcommand();
Subcommand plan_subcommand();
Subcommand clean_subcommand();
Subcommand renderers_subcommand();
Subcommand paths_subcommand();
Subcommand replay_subcommand();
Subcommand compare_subcommand();
Subcommand report_subcommand();
Subcommand score_subcommand();
Subcommand reproduce_subcommand();
Subcommand behaviours_subcommand();
Subcommand fetch_subcommand();

inline std::vector<Subcommand> all_subcommands() {
  return {info_subcommand(),  plan_subcommand(),      clean_subcommand(),      renderers_subcommand(),
          paths_subcommand(), replay_subcommand(),    compare_subcommand(),    report_subcommand(),
          score_subcommand(), reproduce_subcommand(), behaviours_subcommand(), fetch_subcommand()};
}

}  // namespace palpate::experiments
