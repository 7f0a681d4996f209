// Runs the palpate program as a user does.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "experiments/data/process.h"
#include "tests/in_folder.h"

namespace palpate::experiments {

/// Sets an environment variable for the lifetime of the object; null removes it.
class Environment {
 public:
  Environment(std::string name, const char* value) : name_(std::move(name)) {
    if (const char* old = std::getenv(name_.c_str())) old_ = old, had_ = true;
    value != nullptr ? ::setenv(name_.c_str(), value, 1) : ::unsetenv(name_.c_str());
  }
  Environment(const Environment&) = delete;
  Environment& operator=(const Environment&) = delete;
  ~Environment() { had_ ? ::setenv(name_.c_str(), old_.c_str(), 1) : ::unsetenv(name_.c_str()); }

 private:
  std::string name_, old_;
  bool had_ = false;
};

inline std::string file_text(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

inline void write_text(const std::filesystem::path& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

#ifdef PALPATE_PROGRAM
inline ProcessOutcome palpate_command(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), PALPATE_PROGRAM);
  constexpr double kLimitS = 120.0;
  Result<ProcessOutcome> run = run_process(arguments, kLimitS);
  if (!run) {
    ADD_FAILURE() << run.error().message();
    return {};
  }
  EXPECT_FALSE(run->timed_out);
  return *std::move(run);
}
#endif

}  // namespace palpate::experiments
