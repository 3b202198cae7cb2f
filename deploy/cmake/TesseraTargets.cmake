# One function for a module, one for its test.

# Warnings and sanitizers, for the project's own targets only.
add_library(tessera_options INTERFACE)
target_compile_options(tessera_options INTERFACE -Wall -Wextra -Wshadow -Wnon-virtual-dtor
  $<$<BOOL:${TESSERA_WARNINGS_AS_ERRORS}>:-Werror>)
if(CMAKE_UNITY_BUILD)  # what is said of one file's names and of headers is not true of several files in one
  target_compile_options(tessera_options INTERFACE -Wno-shadow $<$<CXX_COMPILER_ID:GNU>:-Wno-subobject-linkage>)
endif()
target_include_directories(tessera_options INTERFACE ${PROJECT_SOURCE_DIR})
if(TESSERA_SANITIZE)
  target_compile_options(tessera_options INTERFACE -fsanitize=${TESSERA_SANITIZE} -fno-omit-frame-pointer)
  target_link_options(tessera_options INTERFACE -fsanitize=${TESSERA_SANITIZE})
endif()

if(TESSERA_BUILD_FUZZ)  # fuzzers see which branches of our code an input takes
  target_compile_options(tessera_options INTERFACE -fsanitize=fuzzer-no-link)
endif()

# tessera_module(NAME SOURCES a.cc ... [HEADERS a.h ...] [DEPS public ...] [PRIVATE_DEPS ...])
# A static library tessera_NAME made of this folder's files; includes are written from the project's root.
# DEPS are those that the headers name; PRIVATE_DEPS those that only the .cc files include.
function(tessera_module NAME)
  cmake_parse_arguments(ARG "" "" "SOURCES;HEADERS;DEPS;PRIVATE_DEPS" ${ARGN})
  set(target tessera_${NAME})
  add_library(${target} STATIC ${ARG_SOURCES})
  target_sources(${target} PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR} FILES ${ARG_HEADERS})
  target_link_libraries(${target} PUBLIC ${ARG_DEPS} PRIVATE tessera_options ${ARG_PRIVATE_DEPS})
endfunction()

# tessera_executable(NAME COMPONENT package SOURCES main.cc DEPS ...): an installed program in bin/. COMPONENT: the
# package that contains it (TesseraPackages.cmake).
function(tessera_executable NAME)
  cmake_parse_arguments(ARG "" "COMPONENT" "SOURCES;DEPS" ${ARGN})
  add_executable(${NAME} ${ARG_SOURCES})
  target_link_libraries(${NAME} PRIVATE tessera_options ${ARG_DEPS})
  install(TARGETS ${NAME} RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT ${ARG_COMPONENT})
endfunction()

# tessera_test(DIR [DEPS ...] [LABELS ...] [TIMEOUT seconds] [FIXTURE name] [ONE_PROCESS])
# One test program of all tests/DIR/*_test.cc, e.g. DIR = unit/common/base; the name is DIR with underscores.
# Each test is a separate process in ctest; ONE_PROCESS: all run in one process, because their fixture is expensive.
# FIXTURE: the server of tests/support/servers that the tests use.
# Call it from the module's own CMakeLists.txt.
function(tessera_test DIR)
  if(NOT TESSERA_BUILD_TESTS)
    return()
  endif()
  cmake_parse_arguments(ARG "ONE_PROCESS" "TIMEOUT;FIXTURE" "DEPS;LABELS" ${ARGN})
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 300)
  endif()
  string(REPLACE "/" "_" name ${DIR})
  file(GLOB sources CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/tests/${DIR}/*_test.cc)
  if(NOT sources)
    message(FATAL_ERROR "tessera_test(${DIR}): no tests/${DIR}/*_test.cc")
  endif()
  add_executable(${name} ${sources})
  target_link_libraries(${name} PRIVATE tessera_options ${ARG_DEPS} tessera_test_main GTest::gmock)
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/tests)
  # Compiles faster. Tests of numerical code are compiled as the code is.
  if(DIR MATCHES "^(unit/server/|unit/worker/agent|unit/common/(rpc|s3)|e2e)")
    target_compile_options(${name} PRIVATE -O1)
  endif()
  set(properties TIMEOUT ${ARG_TIMEOUT})
  if(ARG_LABELS)  # gtest_discover_tests would take the next property for an empty value
    list(APPEND properties LABELS "${ARG_LABELS}")
  endif()
  if(ARG_FIXTURE)
    list(APPEND properties FIXTURES_REQUIRED ${ARG_FIXTURE}
      ENVIRONMENT TESSERA_TEST_SERVERS=${CMAKE_BINARY_DIR}/servers)
  endif()
  if(ARG_ONE_PROCESS)
    add_test(NAME ${DIR} COMMAND ${name})
    set_tests_properties(${DIR} PROPERTIES ${properties})
    return()
  endif()
  gtest_discover_tests(${name} TEST_PREFIX "${DIR}:" DISCOVERY_TIMEOUT 60
    PROPERTIES ${properties})
endfunction()
