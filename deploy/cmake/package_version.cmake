# The version of the packages: the project's, then the number of commits and the commit if there is a repository, so
# that later packages are upgrades. A tag vVERSION at the commit gives VERSION alone. Read by cpack, and by the
# installation of the changelog. In: CPACK_PACKAGE_VERSION, CPACK_TESSERA_SOURCE_DIR. Out: CPACK_DEBIAN_PACKAGE_VERSION.
function(ask_git OUTPUT)
  execute_process(COMMAND git ${ARGN} WORKING_DIRECTORY ${CPACK_TESSERA_SOURCE_DIR} OUTPUT_VARIABLE output
    OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
  set(${OUTPUT} "${output}" PARENT_SCOPE)
endfunction()

ask_git(tag describe --exact-match --tags --match v${CPACK_PACKAGE_VERSION} HEAD)
ask_git(count rev-list --count HEAD)
ask_git(commit rev-parse --short=8 HEAD)
set(CPACK_DEBIAN_PACKAGE_VERSION ${CPACK_PACKAGE_VERSION})
if(commit AND NOT tag)
  string(APPEND CPACK_DEBIAN_PACKAGE_VERSION ".${count}.g${commit}")
endif()
