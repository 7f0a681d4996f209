#include <gtest/gtest.h>

#include <filesystem>

#include "tests/toolkit/messages.h"
#include "toolkit/stream/depth_source.h"
#include "toolkit/stream/openni_source.h"

namespace palpate::stream {
namespace {

using palpate::test::refused;

// fake_openni.cpp stands beside this program under the plug-in's name.
TEST(OpenNi, APlugInBesideTheProgramOpensTheCamera) {
  const auto source = test::value_of(open_depth_source("openni"));
  EXPECT_EQ(source->describe(), "one pixel");
  DepthFrame frame;
  ASSERT_TRUE(test::value_of(source->next(frame)));
  EXPECT_EQ(frame.depth_mm, std::vector<float>{750.0f});
  EXPECT_TRUE(refused(open_depth_source("openni:7"), "'openni:7'", "there is no camera openni:7"));
  EXPECT_TRUE(refused(open_depth_source("openni2"), "no stream 'openni2'"));
}

}  // namespace
}  // namespace palpate::stream
