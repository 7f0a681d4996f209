# Installation comes with the package files; see docs/architecture.md.
function(palpate_print_summary)
  get_property(modules GLOBAL PROPERTY PALPATE_MODULES)
  list(TRANSFORM modules REPLACE "^palpate_" "")
  list(JOIN modules " " module_list)
  message(STATUS "palpate ${PROJECT_VERSION}: ${CMAKE_BUILD_TYPE}, ${CMAKE_CXX_COMPILER_ID} ${CMAKE_CXX_COMPILER_VERSION}")
  message(STATUS "  modules: ${module_list}")
  message(STATUS "  baselines ${PALPATE_BUILD_BASELINES}, experiments ${PALPATE_BUILD_EXPERIMENTS}, tests ${PALPATE_BUILD_TESTS}, pcd ${PALPATE_WITH_PCD}")
endfunction()
