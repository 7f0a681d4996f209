// `palpate study` in a folder of its own.
#pragma once

#include <string>

#include "tests/experiments/program.h"

namespace palpate::experiments {

class StudyFolder : public OnCommandLine {
 protected:
  template <class... More>
  [[nodiscard]] Words study(const std::string& plan, const std::string& observer, const std::string& out,
                            const More&... more) const {
    return words("study", plan, "--observer", observer, "--out", in(out), more...);
  }
};

}  // namespace palpate::experiments
