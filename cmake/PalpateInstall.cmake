# Installation: libraries, headers, the palpate command, and the package files for find_package(palpate).
#
# One export set per component, so that who links the toolkit needs neither PCL nor CGAL:
#   toolkit (always), scene, device, pcd, voronoi, dem, baselines.   See docs/how-to/change-palpate.md.
include(CMakePackageConfigHelpers)

set(palpate_package_dir "${CMAKE_INSTALL_LIBDIR}/cmake/palpate")

# The component a module belongs to follows from its folder.
function(palpate_component_of target out)
  get_target_property(folder ${target} SOURCE_DIR)
  file(RELATIVE_PATH folder "${PROJECT_SOURCE_DIR}" "${folder}")
  if(folder MATCHES "^toolkit/(pcd|dem|scene|stream|voronoi)")
    set(${out} ${CMAKE_MATCH_1} PARENT_SCOPE)
  elseif(folder MATCHES "^(toolkit|device|baselines)(/|$)")
    set(${out} ${CMAKE_MATCH_1} PARENT_SCOPE)
  else()
    set(${out} "" PARENT_SCOPE)  # experiments and tests: nothing to link
  endif()
endfunction()

set(palpate_components "")
get_property(palpate_modules GLOBAL PROPERTY PALPATE_MODULES)
foreach(module IN LISTS palpate_modules)
  palpate_component_of(${module} component)
  if(component)
    install(TARGETS ${module} EXPORT palpate_${component}_targets
      ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
    list(APPEND palpate_components ${component})
  endif()
endforeach()
list(REMOVE_DUPLICATES palpate_components)

foreach(component IN LISTS palpate_components)
  install(EXPORT palpate_${component}_targets NAMESPACE palpate:: DESTINATION ${palpate_package_dir}
    FILE palpate-${component}-targets.cmake)
endforeach()

# What an application includes, and nothing else.
foreach(folder toolkit device baselines)
  if(folder IN_LIST palpate_components)
    install(DIRECTORY "${PROJECT_SOURCE_DIR}/${folder}/include/" DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}
      FILES_MATCHING PATTERN "*.h")
  endif()
endforeach()

if(TARGET palpate AND PALPATE_BUILD_EXPERIMENTS)
  install(TARGETS palpate RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
  install(FILES "${PROJECT_BINARY_DIR}/experiments/palpate.bash"
    DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions RENAME palpate)
  install(FILES "${PROJECT_BINARY_DIR}/experiments/palpate.1" DESTINATION ${CMAKE_INSTALL_MANDIR}/man1)
  set_target_properties(palpate PROPERTIES INSTALL_RPATH "$ORIGIN/../${CMAKE_INSTALL_LIBDIR}/palpate")
  if(TARGET palpate_formats)
    install(TARGETS palpate_formats LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}/palpate)
  endif()
endif()

if(TARGET palpate-reconstruct)
  install(TARGETS palpate-reconstruct RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
endif()

# Who sits at the machine may open the devices. device/drivers/all_drivers.cpp says which.
# A component of its own, so that a test can pack it by itself.
install(FILES "${PROJECT_SOURCE_DIR}/device/drivers/70-palpate.rules" DESTINATION lib/udev/rules.d COMPONENT udev)

configure_package_config_file("${CMAKE_CURRENT_LIST_DIR}/palpateConfig.cmake.in"
  "${PROJECT_BINARY_DIR}/palpateConfig.cmake" INSTALL_DESTINATION ${palpate_package_dir})
write_basic_package_version_file("${PROJECT_BINARY_DIR}/palpateConfigVersion.cmake"
  COMPATIBILITY SameMinorVersion)
install(FILES "${PROJECT_BINARY_DIR}/palpateConfig.cmake" "${PROJECT_BINARY_DIR}/palpateConfigVersion.cmake"
  DESTINATION ${palpate_package_dir})

# `cpack` in the build folder makes an archive, and a Debian package where dpkg is there; both hold what install() names,
# below /usr, as the system's own do: udev finds the rules there.
if(PROJECT_IS_TOP_LEVEL)
  set(CPACK_PACKAGE_NAME palpate)
  set(CPACK_PACKAGE_VENDOR "Palpate")
  set(CPACK_PACKAGE_CONTACT "Palpate's authors")
  set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "${PROJECT_DESCRIPTION}")
  set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
  set(CPACK_STRIP_FILES ON)
  find_program(PALPATE_DPKG dpkg)
  set(CPACK_GENERATOR TGZ)
  if(PALPATE_DPKG)
    list(APPEND CPACK_GENERATOR DEB)
    set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
    set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
    set(CPACK_DEBIAN_PACKAGE_SECTION science)
    # The daemon reads the rules again, and devices that are plugged in already get them.
    set(CPACK_DEBIAN_PACKAGE_CONTROL_EXTRA "${PROJECT_SOURCE_DIR}/device/drivers/package/postinst")
  endif()
  include(CPack)
endif()

function(palpate_print_summary)
  get_property(modules GLOBAL PROPERTY PALPATE_MODULES)
  list(TRANSFORM modules REPLACE "^palpate_" "")
  list(JOIN modules " " module_list)
  message(STATUS "palpate ${PROJECT_VERSION}")
  message(STATUS "  build       ${CMAKE_BUILD_TYPE}, ${CMAKE_CXX_COMPILER_ID} ${CMAKE_CXX_COMPILER_VERSION}, "
                 "sanitizer: ${PALPATE_SANITIZE}, warnings as errors: ${PALPATE_WARNINGS_AS_ERRORS}")
  message(STATUS "  parts       baselines ${PALPATE_BUILD_BASELINES}, experiments ${PALPATE_BUILD_EXPERIMENTS}, "
                 "pcd ${PALPATE_WITH_PCD}, voronoi ${PALPATE_WITH_VORONOI}, dem ${PALPATE_WITH_DEM}, devices ${PALPATE_WITH_DEVICES}, tests ${PALPATE_BUILD_TESTS}, benchmarks ${PALPATE_BUILD_BENCHMARKS}, "
                 "fuzzers ${PALPATE_BUILD_FUZZERS}")
  message(STATUS "  modules     ${module_list}")
endfunction()
