// Models of a specification, for the tests of generators.
#pragma once

#include <gtest/gtest.h>

#include <string>
#include <utility>

#include "toolkit/cloud/generate.h"

namespace palpate::cloud {

inline GeneratedModel made(const std::string& text) {
  auto spec = parse_named_options(text);
  EXPECT_TRUE(spec) << text;
  auto model = generate(*spec);
  EXPECT_TRUE(model) << text << ": " << (model ? "" : model.error().message());
  return std::move(*model);
}

inline std::string refusal(const std::string& text) {
  const auto model = generate(*parse_named_options(text));
  return model ? "accepted" : model.error().message();
}

}  // namespace palpate::cloud
