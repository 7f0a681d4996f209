// `palpate study` in a folder of its own.
#pragma once

#include <string>
#include <vector>

#include "tests/experiments/program.h"

namespace palpate::experiments {

class StudyFolder : public InFolder {
 protected:
  [[nodiscard]] ProcessOutcome study(const std::string& plan, const std::string& observer,
                                     const std::string& out,
                                     const std::vector<std::string>& more = {}) const {
    std::vector<std::string> arguments = {"study", plan, "--observer", observer, "--out", in(out)};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return palpate_command(arguments);
  }
};

}  // namespace palpate::experiments
