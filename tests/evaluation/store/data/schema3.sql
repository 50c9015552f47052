PRAGMA application_id = 0x53494E53;
PRAGMA user_version = 3;
BEGIN TRANSACTION;
CREATE TABLE costs (
        task TEXT, solver TEXT, settings_hash TEXT, code TEXT, session INTEGER, median_us REAL, p95_us REAL,
        ratio REAL, PRIMARY KEY (task, solver, settings_hash, code));
INSERT INTO "costs" VALUES('short-v0','evaluation.plugins:At','d1f86f0967f0','1',1,100.0,150.0,1.5);
INSERT INTO "costs" VALUES('short-v0','evaluation.plugins:Told','44136fa355b3','1',1,100.0,150.0,1.5);
CREATE TABLE histories (id INTEGER PRIMARY KEY REFERENCES runs (id), history BLOB);
INSERT INTO "histories" VALUES(1,X'789CADC63B0B0100100060AF281924A514A54B4A164A31DC46B1786456926494D848360306038314A6CB64B948D7B132CA6896F2132CFC08C3575F270C38BEB33C81349B04BC9E598A01525B0EF0B06169FB49F715C0C68CE5ED255D3501B303969E87B4D605BCD4595A6ED2F904309162793949E30BC06488E5E6207DAC01AB3E968A9DB4BF053C4558CA56D2F40E701A63895A4847BF97322C4313A9790FF829B0048DA4CB236039CFE2FADD6038F7FFE10BCE24656A');
INSERT INTO "histories" VALUES(2,X'789C0BD0D6B6F9D67B67F7891EB1FDB7276BDB44BEBDBDFB65B7D87E49191D1B61C7DBBB0BBAC4F60777E8D8BC3E716B374BA7D87E7F265D1B7E955BBBEDDBC5F6BB65E9DAFCE9BAB97B52ABD8FE87A7746DD21FDDD87DA9596C7F8E899E4DBCD28DDDEA4D62FB37B6E9D998BCBFBEBBB6416C7FC52B3D1BC94FD77773D78BEDBFA7A76FF35EEEC66E963AB1FD4B5BF46D4EE9DFD8DD5A2BB63FF3BABECD8577D777EB03D985A6063671DBAEEFDE5C23B69F81E1403D35300053016750');
INSERT INTO "histories" VALUES(3,X'789CFBBAE4A64DD406631B4DC1369BECE5376DB69F36B6F967DF66D3BBFAA64DDA4F639BB5B96D367A6B6FDA9CE331B15938ADCD66C38A9B36F2F22636D967DA6C0280EA9F3B9AD89C666FB7615D78D3E647BD89CD59EF769BA689376D3E2E31B1A96B6DB7D9D674D366D77A139B8B2BDB6DBA126EDA88ED31B1D978A7DDE69CD54D9B8E752636ABBEB4DBAC95BA69736CBE89CD41B60E9BCD3F6FD8C4CF34B18914EAB051BF79C3A66F86890D8F60870D03C3817A6A6000D01663C6');
INSERT INTO "histories" VALUES(4,X'789C01F0000FFF10CD08BED16F01BE423687BE306070BE88AE87BE6EA158BE0C570EBED6999ABE9C0D56BED4AD9E3CDC9E44BE677A7FBEA696153DB6770EBD61A8A0BE146EC7BD26A9633C146CB4BE247A49BE0F3EE1BDDC6CAABEE5410BBEEA0A94BEFF6C8FBEDC5E6CBCF9A3A9BE990B61BE52F11EBBBD083FBE7AB148BEF639CEBD5A95A23A7F1273BEFC4124BEBEC2FB3C7BAF9EBE3B73C9BD19AE0ABE2226B9BE52CA3BBC702DA3BEAA23B5BE57B214BD6604A7BE164991BEF05D0FBECE871BBECCD74EBE1FAA27BEF7E3933C21F839BE0ADE7EBD2FF0963B2D4A73BE1880D23CCEDC2ABE4A1BA5BEBA8408BD6689A0BEC5E2C1BE37837D79');
INSERT INTO "histories" VALUES(5,X'789C01F0000FFF3E5E05BE15051CBE281207BFDDF444BEC5EA9FBE8066F3BEBC4DB9BDD347A5BE6859EFBEE4150D3D494634BEF7A902BFCB512B3C4CAFA1BC7CE512BF579806BE7EFEE9BB98F61CBF4E2148BE3CF51CBE3D6819BFFCFDB9BD1B949EBE34050ABFDF5F193D7A90A3BE0EA5F3BE2647443C55A234BE56E8E9BE018D06BED31BA6BCFA47FFBEF95C49BECE22F0BB36A812BFAD4AC0BD17811BBEEFC11FBF9602183D6CEC9CBEDA4B1CBFCC83753C83DDA3BEAE3B0ABF60F904BE2EEA36BEE750EEBE955149BEFE2FA8BCE3E2E3BE24BDC2BD719EE6BB9AC3FEBE5A870B3D4AB519BE196E15BF660C703CB5369DBE03B222BF767B7D6F');
INSERT INTO "histories" VALUES(6,X'789C01F0000FFF92E72FBE0BADE8BC9168A93DDF68A0BEAEB9FFBDF8C20C3ED4FC70BE417D46BE5439033E2D464BBDA88911BE3830B53DA46B9D3C245F7D39D5E4FB3C4403B9BD102EBB3DE890C7BB020267BE771D163C5CDC983C81C669BE2DF13ABE6E1F6D3D862202BE23C986BE2F6ADB3DEE088CBD8CD604BEE02C123E7C29C8BDC821A53D4C90DF3D506013BE9EE6033EE6FE1D3DDB1211BEFDD248BD9C2D8BBC4F34F6BD9A1C81BE5459D2BC00A815BE10A480BED1E3363D83DC3EBE601A4EBDA0D8133EE0F41ABE60CEF13DCA602B3EA46A77BDA4CF903D57F6DC3DF59B10BD67C3F6BD930A8B3C0E970EBE24E475BED83C49BDB4CB7748');
CREATE TABLE runs (
    id INTEGER PRIMARY KEY, task TEXT, suite TEXT, solver TEXT, settings_hash TEXT, code TEXT, run INTEGER,
    settings TEXT, session INTEGER REFERENCES sessions (id), status TEXT, reason TEXT, traceback TEXT,
    repairs INTEGER, fallbacks INTEGER DEFAULT 0,
    t_conv_e REAL, t_conv_n REAL, t_conv_u REAL, hold_max_e REAL, hold_max_n REAL, hold_max_u REAL, steady_mean_e REAL, steady_mean_n REAL, steady_mean_u REAL, steady_std_e REAL, steady_std_n REAL, steady_std_u REAL, steady_rms_e REAL, steady_rms_n REAL, steady_rms_u REAL, final_e REAL, final_n REAL, final_u REAL, heading REAL, step_s REAL, nees_25 REAL, nees_50 REAL, nees_75 REAL, nees_100 REAL, UNIQUE (task, suite, solver, settings_hash, code, run));
INSERT INTO "runs" VALUES(1,'short-v0','a96d556b2ece66e5','evaluation.plugins:At','d1f86f0967f0','1',0,'{"epoch": 150}',1,'raised','step raised ArithmeticError: no square root, at 15.0 s','Traceback (most recent call last):
  File "/tmp/navbase/sins_env/evaluation/guard.py", line 47, in _call
    return getattr(self.estimator, name)(*args)
           ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
  File "/tmp/navbase/tests/evaluation/plugins.py", line 87, in step
    raise ArithmeticError("no square\nroot")
ArithmeticError: no square
root

The above exception was the direct cause of the following exception:

Traceback (most recent call last):
  File "/tmp/navbase/sins_env/evaluation/episode.py", line 98, in _play_or_split
    return play(job, estimator, done)
           ^^^^^^^^^^^^^^^^^^^^^^^^^^
  File "/tmp/navbase/sins_env/evaluation/episode.py", line 134, in play
    action = guard.step(obs)
             ^^^^^^^^^^^^^^^
  File "/tmp/navbase/sins_env/evaluation/guard.py", line 71, in step
    action = self._call("step", obs)
             ^^^^^^^^^^^^^^^^^^^^^^^
  File "/tmp/navbase/sins_env/evaluation/guard.py", line 51, in _call
    raise EstimatorError(f"{name} raised {type(error).__name__}: {'' ''.join(str(error).split())}") from error
sins_env.evaluation.guard.EstimatorError: step raised ArithmeticError: no square root

During handling of the above exception, another exception occurred:

Traceback (most recent call last):
  File "/tmp/navbase/sins_env/evaluation/guard.py", line 47, in _call
    return getattr(self.estimator, name)(*args)
           ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
  File "/tmp/navbase/tests/evaluation/plugins.py", line 87, in step
    raise ArithmeticError("no square\nroot")
ArithmeticError: no square
root
',0,0,9e999,9e999,9e999,1.57079632679489655799e+00,3.14159265358979311599e+00,3.14159265358979311599e+00,4.30293610740202892017e-01,7.84608254376466418555e-01,5.56560238720810174228e-01,6.67249533031329278287e-01,1.37895045308112718096e+00,1.51236963026012771749e+00,7.93961290476033365592e-01,1.58654166818534325678e+00,1.61152759760983332881e+00,1.57079632679489655799e+00,3.14159265358979311599e+00,3.14159265358979311599e+00,NULL,2.82277677831109703471e-04,8.41100737301339762552e+00,8.4183662609767360152e+00,NULL,NULL);
INSERT INTO "runs" VALUES(2,'short-v0','a96d556b2ece66e5','evaluation.plugins:At','d1f86f0967f0','1',1,'{"epoch": 150}',1,'raised','step raised ArithmeticError: no square root, at 15.0 s','Traceback (most recent call last):
  File "/tmp/navbase/sins_env/evaluation/guard.py", line 47, in _call
    return getattr(self.estimator, name)(*args)
           ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
  File "/tmp/navbase/tests/evaluation/plugins.py", line 87, in step
    raise ArithmeticError("no square\nroot")
ArithmeticError: no square
root

The above exception was the direct cause of the following exception:

Traceback (most recent call last):
  File "/tmp/navbase/sins_env/evaluation/episode.py", line 98, in _play_or_split
    return play(job, estimator, done)
           ^^^^^^^^^^^^^^^^^^^^^^^^^^
  File "/tmp/navbase/sins_env/evaluation/episode.py", line 134, in play
    action = guard.step(obs)
             ^^^^^^^^^^^^^^^
  File "/tmp/navbase/sins_env/evaluation/guard.py", line 71, in step
    action = self._call("step", obs)
             ^^^^^^^^^^^^^^^^^^^^^^^
  File "/tmp/navbase/sins_env/evaluation/guard.py", line 51, in _call
    raise EstimatorError(f"{name} raised {type(error).__name__}: {'' ''.join(str(error).split())}") from error
sins_env.evaluation.guard.EstimatorError: step raised ArithmeticError: no square root

During handling of the above exception, another exception occurred:

Traceback (most recent call last):
  File "/tmp/navbase/sins_env/evaluation/guard.py", line 47, in _call
    return getattr(self.estimator, name)(*args)
           ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
  File "/tmp/navbase/tests/evaluation/plugins.py", line 87, in step
    raise ArithmeticError("no square\nroot")
ArithmeticError: no square
root

The above exception was the direct cause of the following exception:

Traceback (most recent call last):
  File "/tmp/navbase/sins_env/evaluation/episode.py", line 98, in _play_or_split
    return play(job, estimator, done)
           ^^^^^^^^^^^^^^^^^^^^^^^^^^
  File "/tmp/navbase/sins_env/evaluation/episode.py", line 134, in play
    action = guard.step(obs)
             ^^^^^^^^^^^^^^^
  File "/tmp/navbase/sins_env/evaluation/guard.py", line 71, in step
    action = self._call("step", obs)
             ^^^^^^^^^^^^^^^^^^^^^^^
  File "/tmp/navbase/sins_env/evaluation/guard.py", line 51, in _call
    raise EstimatorError(f"{name} raised {type(error).__name__}: {'' ''.join(str(error).split())}") from error
sins_env.evaluation.guard.EstimatorError: step raised ArithmeticError: no square root

During handling of the above exception, another exception occurred:

Traceback (most recent call last):
  File "/tmp/navbase/sins_env/evaluation/guard.py", line 47, in _call
    return getattr(self.estimator, name)(*args)
           ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
  File "/tmp/navbase/tests/evaluation/plugins.py", line 87, in step
    raise ArithmeticError("no square\nroot")
ArithmeticError: no square
root
',0,0,9e999,9e999,9e999,1.57079632679489655799e+00,3.14159265358979311599e+00,3.14159265358979311599e+00,4.08457442331680853353e-01,7.96163238649330473606e-01,3.63084241081049308164e-01,6.80024757438237648088e-01,1.37219022608932061935e+00,1.62556249384189821505e+00,7.93266129949509624097e-01,1.58643686264271210895e+00,1.66561807972502906594e+00,1.57079632679489655799e+00,3.14159265358979311599e+00,3.14159265358979311599e+00,NULL,1.4623877851535868372e-04,5.55604924378217113201e+00,5.5591019316508880621e+00,NULL,NULL);
INSERT INTO "runs" VALUES(3,'short-v0','a96d556b2ece66e5','evaluation.plugins:At','d1f86f0967f0','1',2,'{"epoch": 150}',1,'raised','step raised ArithmeticError: no square root, at 15.0 s','Traceback (most recent call last):
  File "/tmp/navbase/sins_env/evaluation/guard.py", line 47, in _call
    return getattr(self.estimator, name)(*args)
           ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
  File "/tmp/navbase/tests/evaluation/plugins.py", line 87, in step
    raise ArithmeticError("no square\nroot")
ArithmeticError: no square
root

The above exception was the direct cause of the following exception:

Traceback (most recent call last):
  File "/tmp/navbase/sins_env/evaluation/episode.py", line 98, in _play_or_split
    return play(job, estimator, done)
           ^^^^^^^^^^^^^^^^^^^^^^^^^^
  File "/tmp/navbase/sins_env/evaluation/episode.py", line 134, in play
    action = guard.step(obs)
             ^^^^^^^^^^^^^^^
  File "/tmp/navbase/sins_env/evaluation/guard.py", line 71, in step
    action = self._call("step", obs)
             ^^^^^^^^^^^^^^^^^^^^^^^
  File "/tmp/navbase/sins_env/evaluation/guard.py", line 51, in _call
    raise EstimatorError(f"{name} raised {type(error).__name__}: {'' ''.join(str(error).split())}") from error
sins_env.evaluation.guard.EstimatorError: step raised ArithmeticError: no square root

During handling of the above exception, another exception occurred:

Traceback (most recent call last):
  File "/tmp/navbase/sins_env/evaluation/guard.py", line 47, in _call
    return getattr(self.estimator, name)(*args)
           ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
  File "/tmp/navbase/tests/evaluation/plugins.py", line 87, in step
    raise ArithmeticError("no square\nroot")
ArithmeticError: no square
root

The above exception was the direct cause of the following exception:

Traceback (most recent call last):
  File "/tmp/navbase/sins_env/evaluation/episode.py", line 98, in _play_or_split
    return play(job, estimator, done)
           ^^^^^^^^^^^^^^^^^^^^^^^^^^
  File "/tmp/navbase/sins_env/evaluation/episode.py", line 134, in play
    action = guard.step(obs)
             ^^^^^^^^^^^^^^^
  File "/tmp/navbase/sins_env/evaluation/guard.py", line 71, in step
    action = self._call("step", obs)
             ^^^^^^^^^^^^^^^^^^^^^^^
  File "/tmp/navbase/sins_env/evaluation/guard.py", line 51, in _call
    raise EstimatorError(f"{name} raised {type(error).__name__}: {'' ''.join(str(error).split())}") from error
sins_env.evaluation.guard.EstimatorError: step raised ArithmeticError: no square root

During handling of the above exception, another exception occurred:

Traceback (most recent call last):
  File "/tmp/navbase/sins_env/evaluation/guard.py", line 47, in _call
    return getattr(self.estimator, name)(*args)
           ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
  File "/tmp/navbase/tests/evaluation/plugins.py", line 87, in step
    raise ArithmeticError("no square\nroot")
ArithmeticError: no square
root
',0,0,9e999,9e999,9e999,1.57079632679489655799e+00,3.14159265358979311599e+00,3.14159265358979311599e+00,4.20326153028073912221e-01,8.09306436812568086303e-01,8.13405484182591398401e-01,6.73080979827255676539e-01,1.36450081562769853782e+00,1.36210267566709553044e+00,0.79354400024485,1.58645497399545187811e+00,1.58649052337471485607e+00,1.57079632679489655799e+00,3.14159265358979311599e+00,3.14159265358979311599e+00,NULL,1.4261052350372709443e-04,2.71821138664185291133e+00,2.71498206306795930586e+00,NULL,NULL);
INSERT INTO "runs" VALUES(4,'short-v0','a96d556b2ece66e5','evaluation.plugins:Told','44136fa355b3','1',0,'{}',1,'diverged','east error beyond 10 deg at 1.3 s','',0,0,9e999,9e999,9e999,1.71857914641505182817e-01,0.326205445025041,3.78683250799736192959e-01,-8.23002873625504338672e-02,-1.52398097360058354388e-01,-2.73468248725584672786e-01,7.84267423001915736646e-02,0.126551474184218,5.90504076233752187019e-02,1.13684173075142863629e-01,1.98092038449718149673e-01,2.79771037996296212391e-01,-3.33297018985062379337e-02,-3.13548266001991871032e-01,-3.78683250799736192959e-01,2.57177047339191444663e-01,1.5207866613309305964e-06,NULL,NULL,NULL,NULL);
INSERT INTO "runs" VALUES(5,'short-v0','a96d556b2ece66e5','evaluation.plugins:Told','44136fa355b3','1',1,'{}',1,'diverged','north error beyond 10 deg at 1.2 s','',0,0,9e999,9e999,9e999,1.97997001860532373385e-01,3.2004936556977003903e-01,6.35528749729049824424e-01,-7.40609135332690182718e-02,-1.64066619103721250683e-01,-5.3427766345679927884e-01,8.69808227644347231599e-02,1.20768816585718100076e-01,5.88744463191855083028e-02,1.14239583517099507758e-01,2.03722759071342768288e-01,5.37511694847886634107e-01,1.46513937790206816985e-02,-3.07058002091479542716e-01,-6.35528749729049824424e-01,-2.28137954909541891893e-03,1.5207866613309305964e-06,NULL,NULL,NULL,NULL);
INSERT INTO "runs" VALUES(6,'short-v0','a96d556b2ece66e5','evaluation.plugins:Told','44136fa355b3','1',2,'{}',1,'diverged','east error beyond 10 deg at 1.1 s','',0,0,9e999,9e999,9e999,1.87092210333451830495e-01,2.51251711518719833549e-01,1.71442043528433729626e-01,-1.31862235254060239375e-01,-7.06977256474785181739e-02,6.80226002602084545145e-02,7.92205144888945139713e-02,1.26656266902281045005e-01,6.0190673120476545499e-02,1.53829577786855659082e-01,1.45051640312503865581e-01,9.08294626035856672574e-02,-1.39248109040812029224e-01,-2.40128094244625389652e-01,-4.913029040141484588e-02,5.99908446222331637187e-01,1.5207866613309305964e-06,NULL,NULL,NULL,NULL);
CREATE TABLE sessions (
        id INTEGER PRIMARY KEY, started TEXT DEFAULT CURRENT_TIMESTAMP, versions TEXT, machine TEXT);
INSERT INTO "sessions" VALUES(1,'2026-11-27 14:00:00','{}','a machine');
CREATE TABLE tasks (task TEXT PRIMARY KEY, criteria TEXT, definition TEXT, digest TEXT, bound TEXT);
INSERT INTO "tasks" VALUES('short-v0','{"epoch_s": 0.1, "num_epochs": 200, "coarse_epochs": 0, "delta": [0.0003393695767766752, 0.0003393695767766752, 0.012217304763960306], "limit": [0.17453292519943295, 0.17453292519943295, 2.617993877991494], "hold_s": 5.0, "known_start": true, "scored": true, "lost_heading": false}','{"name": "short-v0", "what": "short", "source": "000 ch. 3, 5", "env_id": "SINS/AlignSway-v0", "delta_azimuth_deg": 0.7, "delta_level_arcsec": 70.0, "kwargs": {"imu": "thesis-white", "gps": "thesis", "start": "told", "prior": "matched", "duration": 20.0}, "hold_s": 5.0, "suite_seed": 0, "windows": 0}','382fb8dc50347b7d','{"t": [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0, 16.0, 17.0, 18.0, 19.0, 20.0], "sigma": [[0.00916146528263218, 0.009171358601467483, 0.26162237352677437], [0.0037944766128068397, 0.0038303655500194077, 0.26139830319666857], [0.002122089905260157, 0.0021616889821272837, 0.2599629850482633], [0.0013964146620136844, 0.001421847236578239, 0.2553780758241191], [0.0010092765482390042, 0.001024187605624644, 0.24842449564135782], [0.0007726852513667868, 0.0007814148009816407, 0.2417533473073728], [0.0006144882098832904, 0.0006161403885561314, 0.234769689473296], [0.000504559851825347, 0.0005022170742538239, 0.22745482354790356], [0.0004270922090120117, 0.000424233463199468, 0.22269891061277106], [0.0003708923248458605, 0.00036733486560121194, 0.22038088603975267], [0.0003282538114054971, 0.00032338969638911173, 0.2173254332707872], [0.0002948386383114331, 0.0002884063772313968, 0.21366707606608354], [0.000268244347544758, 0.0002591733132091268, 0.21013136913222885], [0.00024700212750875824, 0.0002350718462406769, 0.20589691628799844], [0.0002307143602707732, 0.000216082492383271, 0.20221427102338782], [0.00021872791464386612, 0.00020081104597636506, 0.19983390596611045], [0.00020961256722463288, 0.00018808155310639206, 0.19724285106865663], [0.0002020452274506021, 0.00017727265675068876, 0.19418322299438018], [0.00019549959198537619, 0.00016776772875093892, 0.19084391999757938], [0.0001897787882243614, 0.0001595062129015872, 0.18666481770821608]], "steady": [0.003541093337730457, 0.003545711342405807, 0.22563038014250095], "final": [0.0001897787882243614, 0.0001595062129015872, 0.18666481770821608], "epochs": [1, 200], "holds": true}');
COMMIT;
