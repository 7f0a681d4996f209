// The options of everything that has some: what they say of each other is true.
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>

#include <palpate/generate.h>
#include <palpate/paths.h>
#include "experiments/run/cleaning.h"
#include "experiments/session/session.h"

namespace palpate::experiments {
namespace {

using Visit = std::function<void(const std::string& owner, const std::vector<OptionSpec>& specs)>;

void for_all_owners(const Visit& visit) {
  const render::Registry registry = all_renderers();
  for (const render::RendererInfo& info : registry.all()) visit(info.name, info.options);
  for (const cloud::Generator& generator : cloud::generators()) visit(generator.name, generator.options);
  for (const paths::PathGenerator& generator : paths::path_generators())
    visit(generator.name, generator.options);
  for (const scene::CleaningStep& step : all_cleaning().all()) visit(step.name, step.options);
}

const OptionSpec* find(const std::vector<OptionSpec>& specs, const std::string& key) {
  const auto at = std::find_if(specs.begin(), specs.end(), [&](const OptionSpec& s) { return s.key == key; });
  return at == specs.end() ? nullptr : &*at;
}

Options one(const std::string& key, const std::string& value) {
  Options options;
  options.set(key, value);
  return options;
}

TEST(AllOptions, TheirDefaultsAreValuesOfTheirs) {
  for_all_owners([](const std::string& owner, const std::vector<OptionSpec>& specs) {
    for (const OptionSpec& spec : specs) {
      const Result<Options> checked = validate(one(spec.key, spec.default_value), specs, owner);
      EXPECT_TRUE(checked.ok()) << checked.error().message();
    }
  });
}

TEST(AllOptions, TheirConditionsNameOptionsAndValuesThatExist) {
  std::size_t conditions = 0;
  for_all_owners([&](const std::string& owner, const std::vector<OptionSpec>& specs) {
    for (const OptionSpec& spec : specs)
      for (const OptionCondition& condition : spec.only_with) {
        ++conditions;
        const OptionSpec* other = find(specs, condition.key);
        ASSERT_NE(other, nullptr) << owner << ": " << spec.key << " needs " << condition.key;
        EXPECT_NE(other, &spec);
        for (const std::string& value : condition.values) {
          // With its own condition met or not, the value must be one that the option may have.
          std::vector<OptionSpec> free = {*other};
          free.front().only_with.clear();
          EXPECT_TRUE(validate(one(other->key, value), free, owner).ok())
              << owner << ": " << other->key << "=" << value;
        }
      }
  });
  EXPECT_GT(conditions, 30u);
}

}  // namespace
}  // namespace palpate::experiments
